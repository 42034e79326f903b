"""The bridge that knows the leader from messages, and the sender, as processes over DDS and UDP."""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from studies.v2x.impostor import ContestedSender, Impostor
from tests.integration.cam_ego import BRIDGE, SENDER, Ego, free_port

from iptm_core.routes import build_route
from iptm_ros.diagnostics import status_values
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import DatagramSender, EndOfTick
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Foresight, SenderSettings


@pytest.fixture
def ego(peer: Any) -> Ego:
    return Ego(peer)


def start(launcher: Any, port: int, **faults: object) -> tuple[Any, Any]:
    bridge = launcher.start_node(
        BRIDGE,
        parameters={"leader_source": "cam", "cam_port": port, "cycle": "us06"},
    )
    sender = launcher.start_node(SENDER, parameters={"to_port": port, "cycle": "us06", **faults})
    return bridge, sender


def test_over_the_wire_the_answers_are_those_without_it(launcher: Any, ego: Ego) -> None:
    """Two processes, a socket between them, losses and delays: bit for bit what the pure parts say."""
    faults = {"loss_probability": 0.3, "link_delay_s": 0.3, "link_jitter_s": 0.2, "sender_seed": 5}
    bridge, sender = start(launcher, free_port(), **faults)
    ego.meet("v2x_sender")
    route = build_route("us06", initial_gap_m=15.0)
    settings = SenderSettings(**faults)  # type: ignore[arg-type]
    pure = SimulatedRadio(
        CamSender(route.leader, route.road_line, settings), CamBridge(route.road_line)
    )
    for tick in range(25):
        position_m = float(route.leader.positions_at(float(tick))) - 14.0
        preview = ego.tick(float(tick), position_m)
        expected = pure.answer(tick * 10**9, position_m)
        np.testing.assert_array_equal(preview.positions_m, expected.preview.positions_m)
        np.testing.assert_array_equal(preview.speeds_m_s, expected.preview.speeds_m_s)
        if expected.leader is not None:
            ego.peer.wait_until(lambda at=tick: at * 10**9 in ego.leaders, what="the leader")
            assert ego.leaders[tick * 10**9] == expected.leader
    ego.peer.wait_until(
        lambda: (
            ego.statuses and status_values(ego.statuses[-1]).get("predictor") == "received_path"
        ),
        what="the predictor on /diagnostics",
    )
    values = status_values(ego.statuses[-1])
    assert values["leader_station"] == "4711"
    assert values["lost_between_sender_and_bridge"] == "0"
    assert sender.stop(signal.SIGINT) == 0
    assert bridge.stop(signal.SIGINT) == 0


def test_a_contested_identity_is_on_diagnostics_within_a_second(launcher: Any, ego: Ego) -> None:
    """A second sender keeps the speed of 10 s while the leader accelerates."""
    port, route = free_port(), build_route("us06", initial_gap_m=15.0)
    launcher.start_node(
        BRIDGE, parameters={"leader_source": "cam", "cam_port": port, "cycle": "us06"}
    )
    settings = SenderSettings(foresight=Foresight.NONE)
    sender = ContestedSender(route.leader, route.road_line, settings, Impostor(10.0))
    with closing(DatagramSender("127.0.0.1", port)) as radio:
        ego.meet()
        for tick in range(13):
            now_ns = tick * 10**9
            for datagram in sender.take(now_ns - 10**9 if tick else None, now_ns)[0]:
                radio.send(datagram[1])
            radio.end_tick(now_ns)
            ego.tick(float(tick))
    ego.peer.wait_until(
        lambda: any("contradict" in status.message for status in ego.statuses),
        what="the contested identity on /diagnostics",
    )
    (status,) = [found for found in ego.statuses if "contradict" in found.message][:1]
    assert status.level == DiagnosticStatus.WARN
    station, since = status_values(status)["contested_stations"].split(" since ")
    assert station == "4711"
    assert 10.0 < float(since.removesuffix(" s")) <= 11.0


def test_without_a_sender_the_bridge_says_what_it_waits_for(launcher: Any, ego: Ego) -> None:
    port = free_port()
    launcher.start_node(
        BRIDGE, parameters={"leader_source": "cam", "cam_port": port, "cam_lock_step": True}
    )
    ego.meet()
    ego.move(0.0)
    ego.peer.wait_until(
        lambda: any("end of the tick" in status.message for status in ego.statuses),
        what="the reason on /diagnostics",
    )
    assert ego.previews == {}
    # Noise changes nothing; the end of the tick lets it answer, without a leader.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        for _ in range(50):
            radio.sendto(bytes(30), ("127.0.0.1", port))
        radio.sendto(EndOfTick(0, 50).encode(), ("127.0.0.1", port))
    ego.peer.wait_until(lambda: 0 in ego.previews, what="an answer")
    assert ego.previews[0].times_s.size == 0
    assert ego.leaders == {}
    ego.peer.wait_until(
        lambda: any(
            status_values(status).get("rejected_packet") == "50" for status in ego.statuses
        ),
        what="the count of what was refused",
    )


def test_a_port_in_use_is_refused(refused: Callable[..., str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = int(taken.getsockname()[1])
        line = refused(BRIDGE, parameters={"leader_source": "cam", "cam_port": port})
    assert "cam_port" in line


def test_a_topic_without_the_package_of_its_type_is_refused(refused: Callable[..., str]) -> None:
    parameters = {"leader_source": "cam", "cam_lock_step": False, "cam_topic": "/cam"}
    assert "etsi_its_cam_msgs" in refused(BRIDGE, parameters=parameters)


PORTION = 100


def unread_bytes(port: int) -> int:
    """Return the size of what waits in the kernel for the UDP socket of a port."""
    for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]:
        _, own, _, _, queues, *_ = line.split()
        if int(own.partition(":")[2], 16) == port:
            return int(queues.partition(":")[2], 16)
    raise LookupError(port)


def test_two_thousand_datagrams_a_second_do_not_drown_the_leader(launcher: Any, ego: Ego) -> None:
    """Four seconds of a crowd of two hundred cars at 10 Hz beside the leader."""
    port = free_port()
    launcher.start_node(
        BRIDGE,
        parameters={"leader_source": "cam", "cam_port": port, "cycle": "us06"},
    )
    ego.meet()
    route = build_route("us06", initial_gap_m=15.0)
    leader = CamSender(route.leader, route.road_line, SenderSettings())
    crowd = [
        CamSender(
            route.leader,
            route.road_line,
            SenderSettings(station_id=10_000 + number, foresight="none", vehicle_length_m=4.5),  # type: ignore[arg-type]
        )
        for number in range(5)
    ]
    sent = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        for tick in range(4):
            noise = [
                datagram
                for sender in crowd
                for _, datagram in sender.arrivals((tick - 1) * 10**9, tick * 10**9)
            ]
            own = leader.arrivals((tick - 1) * 10**9, tick * 10**9)
            for number in range(2000):
                if number % PORTION == 0:
                    # The bridge is tested, not the queue of the kernel for a process that does not run.
                    ego.peer.wait_until(
                        lambda: not unread_bytes(port), what="the socket to be read"
                    )
                radio.sendto(noise[number % len(noise)], ("127.0.0.1", port))
                if number % 200 == 0 and number // 200 < len(own):
                    radio.sendto(own[number // 200][1], ("127.0.0.1", port))
                    sent += 1
            sent += 2000
            radio.sendto(EndOfTick(tick * 10**9, sent).encode(), ("127.0.0.1", port))
            preview = ego.tick(float(tick))
    assert preview.generated_at_s == 3.0
    ego.peer.wait_until(
        lambda: (
            ego.statuses
            and status_values(ego.statuses[-1]).get("lost_between_sender_and_bridge") == "0"
        ),
        what="nothing lost on the way",
    )


def test_a_ego_alone_on_the_road_is_held_by_its_rules(launcher: Any, ego: Ego) -> None:
    """No car is heard: a limit of 36 km/h, and a line at 60 m that stays closed; no vehicle is reported."""
    port = free_port()
    bridge = launcher.start_node(
        BRIDGE,
        parameters={
            "leader_source": "cam",
            "cam_port": port,
            "cam_lock_step": False,
            "ego_keeps_rules": True,
            "speed_limits_km_h": "0:36",
            "signals": "60.0:1000.0:900.0:50.0",
        },
    )
    ego.meet()
    preview = ego.tick(0.0, 0.0)
    assert not preview.times_s.size
    assert not ego.leaders
    road = ego.roads[0]
    assert not road.has_leader
    assert road.limits is not None
    assert road.limits.limits_m_s.tolist() == [pytest.approx(10.0)]
    # The ego vehicle halts 2 m before the line.
    assert [stop.position_m for stop in road.stops] == [58.0]
    assert road.stops[0].until_s == pytest.approx(901.0)
    assert bridge.stop(signal.SIGINT) == 0

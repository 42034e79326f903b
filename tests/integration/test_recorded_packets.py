"""Radio traffic in a bag: a bridge that reads it again decides and reports as the one that heard it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.integration.cam_ego import BRIDGE, SENDER, Ego, free_port

from iptm_core.routes import build_route
from iptm_core.state import LeaderPreview
from iptm_ros.diagnostics import status_values
from iptm_ros.topics import TOPICS, Topic
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.node_leader_answers import read_recording
from iptm_v2x_bridge.radio_recording import SimulatedRadio

TICKS = 4
QUIET_TICKS = 2
"""Ticks after the sender has ended, so that the last numbers are those of a tick."""
NS = 10**9
RECORDER = "iptm_ros.recording.recorder_cli"
OWN_NUMBERS = ("rejected_", "datagrams", "messages", "station", "leader", "predictor", "preview")


@pytest.fixture
def ego(peer: Any) -> Ego:
    return Ego(peer)


def ego_m(tick: int) -> float:
    return 0.5 * tick


def bits(preview: LeaderPreview) -> bytes:
    arrays = (preview.times_s, preview.positions_m, preview.speeds_m_s)
    return b"".join(array.tobytes() for array in arrays)


def numbers(values: dict[str, str]) -> dict[str, str]:
    """Reports of the bridge on the radio traffic, without machine-dependent values."""
    return {name: text for name, text in values.items() if name.startswith(OWN_NUMBERS)}


def forget(ego: Ego) -> None:
    ego.leaders.clear()
    ego.previews.clear()
    ego.statuses.clear()


def drive(ego: Ego, ticks: range) -> None:
    for tick in ticks:
        ego.tick(float(tick), ego_m(tick))
        ego.peer.wait_until(
            lambda at=tick: at * NS in ego.leaders or not ego.previews[at * NS].times_s.size,
            what="the leader",
        )


def test_a_bag_with_the_datagrams_repeats_the_drive(
    launcher: Any, ego: Ego, tmp_path: Path
) -> None:
    """By the clock of the computer, as with a radio; in lock-step see `test_cam_closed_loop`."""
    port = free_port()
    common = {"leader_source": "cam", "cycle": "nycc"}
    by_clock = {"trip_start_timestamp_ms": -1}
    bag = tmp_path / "drive"
    recorder = launcher.start_module(RECORDER, bag, "--topics", TOPICS[Topic.DATAGRAMS].name)
    heard = {"cam_port": port, "cam_lock_step": False, "publish_datagrams": True}
    live = launcher.start_node(BRIDGE, parameters={**common, **by_clock, **heard})
    sent = {"to_port": port, "cycle": "nycc", "loss_probability": 0.3, "follow_clock": False}
    sender = launcher.start_node(SENDER, parameters={**by_clock, **sent})
    # The bridge publishes datagrams at its first tick: it must have found the recorder, not only this node.
    ego.meet("recorder")

    def datagrams() -> int:
        return int(status_values(ego.statuses[-1]).get("datagrams", 0)) if ego.statuses else 0

    for tick in range(TICKS):
        before = datagrams()
        drive(ego, range(tick, tick + 1))
        ego.peer.wait_until(lambda before=before: datagrams() > before, what="messages in between")
    assert sender.stop(signal.SIGINT) == 0
    ego.settled_values()
    drive(ego, range(TICKS, TICKS + QUIET_TICKS))
    reported = numbers(ego.settled_values())
    leaders, previews = dict(ego.leaders), {at: bits(p) for at, p in ego.previews.items()}
    assert int(reported["datagrams"]) > 20
    assert reported["leader_station"] == "4711"
    for process in (recorder, live):
        assert process.stop(signal.SIGINT) == 0

    # The pure parts, from the bag alone.
    recording = read_recording(bag, port, 0, "", pytest.fail)
    road = build_route("nycc", initial_gap_m=15.0).road_line
    pure = SimulatedRadio(
        recording, CamBridge(road, start_timestamp_ms=recording.start_timestamp_ms)
    )
    for at_ns in sorted(previews):
        answer = pure.answer(at_ns, ego_m(at_ns // NS))
        assert bits(answer.preview) == previews[at_ns]
        assert answer.leader == leaders.get(at_ns)
    own = {name: str(value) for name, value in pure.bridge.report().items()}
    assert {name: own[name] for name in own if name.startswith("rejected_")} == {
        name: reported[name] for name in reported if name.startswith("rejected_")
    }

    # A fresh process, without a sender.
    ego.peer.wait_until(lambda: not ego.state.get_subscription_count(), what="the bridge to leave")
    forget(ego)
    again = launcher.start_node(BRIDGE, parameters={**common, "recorded_packets": bag})
    ego.meet()
    drive(ego, range(len(previews)))
    assert {at: bits(p) for at, p in ego.previews.items()} == previews
    assert ego.leaders == leaders
    assert numbers(ego.settled_values()) == reported
    assert again.stop(signal.SIGINT) == 0


def test_what_is_no_recording_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    example = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"
    for file, word in ((tmp_path / "none", "none"), (example, "v2x/datagrams")):
        parameters = {"leader_source": "cam", "recorded_packets": file}
        assert word in refused(BRIDGE, parameters=parameters)

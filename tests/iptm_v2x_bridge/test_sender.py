"""What a receiver gets of a tick, and what the car behind makes of an announced plan."""

from __future__ import annotations

import socket
from contextlib import closing

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.state import FloatArray
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import DatagramSender, EndOfTick
from iptm_v2x_bridge.messages.cam import CamMessage, decode_datagram
from iptm_v2x_bridge.sender import EgoTick, PlanSender
from iptm_v2x_bridge.settings import Foresight, SenderSettings

NS = 10**9
GAP_M = 15.0
PLAN_S = np.array([0.0, 1.0, 2.0, 3.0, 8.0, 13.0, 18.0, 23.0, 28.0])
NONE: FloatArray = np.empty(0)


def speed_m_s(time_s: FloatArray | float) -> FloatArray:
    """Pulls away with 1 m/s^2 up to 12 m/s."""
    return np.clip(time_s, 0.0, 12.0)


def position_m(time_s: FloatArray | float) -> FloatArray:
    return np.where(
        time_s < 12.0, 0.5 * np.square(time_s), 72.0 + 12.0 * (np.asarray(time_s) - 12.0)
    )


def tick(second: int, *, plans: bool = True) -> EgoTick:
    nodes = second + np.union1d(PLAN_S, [12.0 - second] if 0 < 12 - second < 28 else [])
    return EgoTick(
        second * NS,
        float(position_m(float(second))),
        float(speed_m_s(float(second))),
        nodes if plans else NONE,
        speed_m_s(nodes) if plans else NONE,
    )


def messages(sender: PlanSender, second: int, *, plans: bool = True) -> list[CamMessage]:
    found = []
    for datagram in sender.arrivals(tick(second, plans=plans)):
        read = decode_datagram(datagram)
        assert isinstance(read, tuple), read
        found.append(read[0])
    return found


def test_the_car_behind_knows_the_plan() -> None:
    sender, bridge = PlanSender(ROAD, SenderSettings(), GAP_M), CamBridge(ROAD)
    for second in range(20):
        for datagram in sender.arrivals(tick(second)):
            assert bridge.receive(datagram, second * NS) is None
        answer = bridge.answer(second * NS, float(position_m(float(second))) - 5.0)
        assert answer.predictor == "received_path"
        assert answer.leader is not None
        # The leader's rear bumper is at its own position and the gap in front of where the ego vehicle began.
        here_m = GAP_M + float(position_m(float(second)))
        assert here_m - 0.4 < answer.leader.position_m <= here_m
        times = answer.preview.times_s
        assert times[-1] == second + 28.0
        behind_m = GAP_M + position_m(times) - answer.preview.positions_m
        assert behind_m.min() > -0.02
        assert behind_m.max() < 0.75


def test_only_the_message_of_a_tick_tells_the_plan_and_only_as_far_as_it_reaches() -> None:
    sender = PlanSender(ROAD, SenderSettings(), GAP_M)
    before = messages(sender, 0)
    assert len(before) == 30  # it stood there for three seconds
    assert [message.path is not None for message in before] == [False] * 29 + [True]
    assert {message.speed_m_s for message in before} == {0.0}
    told = messages(sender, 1)
    assert [message.path is not None for message in told] == [False] * 9 + [True]
    np.testing.assert_allclose([m.speed_m_s for m in told], np.arange(0.1, 1.05, 0.1), atol=0.006)
    path = told[-1].path
    assert path is not None
    assert 24.0 < path.times_s[-1] <= 28.0
    # Without a plan, or unwilling to tell it, it says where it is.
    assert [m.path for m in messages(sender, 2, plans=False)] == [None] * 10
    silent = PlanSender(ROAD, SenderSettings(foresight=Foresight.NONE), GAP_M)
    assert {m.path for m in messages(silent, 0)} == {None}


def test_a_link_delays_what_was_known_when_it_was_said() -> None:
    prompt = PlanSender(ROAD, SenderSettings(), GAP_M)
    late = PlanSender(ROAD, SenderSettings(link_delay_s=2.0), GAP_M)
    said, heard = [], []
    for second in range(8):
        said.append(prompt.arrivals(tick(second)))
        heard.append(late.arrivals(tick(second)))
    assert heard[:3] == [said[0][:10], said[0][10:20], said[0][20:]]
    assert heard[3:] == said[1:6]


@pytest.mark.parametrize("first", [5, 40])
def test_a_drive_that_is_joined_under_way_begins_with_its_tick(first: int) -> None:
    sender = PlanSender(ROAD, SenderSettings(), GAP_M)
    (only,) = messages(sender, first)
    assert only.speed_m_s == pytest.approx(min(first, 12.0), abs=0.006)
    assert len(messages(sender, first + 1)) == 10
    # A gap in the ticks is not filled with what nobody knows.
    assert len(messages(sender, first + 20)) == 1


TOO_LONG = bytes(70_000)


def test_the_mark_of_a_tick_counts_what_was_lost_on_the_way() -> None:
    with (
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as receiver,
        closing(DatagramSender("127.0.0.1", _port(receiver))) as sender,
    ):
        sender.repeat_end()  # before the first tick there is nothing to say
        for datagram in (b"first", TOO_LONG, b"third"):
            sender.send(datagram)
        sender.end_tick(5)
        sender.repeat_end()
        heard = [receiver.recv(100) for _ in range(4)]
        assert heard == [b"first", b"third", EndOfTick(5, 3).encode(), EndOfTick(5, 3).encode()]
        assert sender.failed == 1
        sender.sent = 0
        sender.end_tick(0)
        assert EndOfTick.decode(receiver.recv(100)) == EndOfTick(0, 0)


def _port(receiver: socket.socket) -> int:
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(10.0)
    return int(receiver.getsockname()[1])

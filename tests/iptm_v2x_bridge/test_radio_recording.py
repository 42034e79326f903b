"""Recorded radio traffic without ROS: the same bits give the same answers and the same numbers."""

from __future__ import annotations

import random

import pytest
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.errors import ParameterError
from iptm_core.routes import Route
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import EndOfTick
from iptm_v2x_bridge.radio_recording import (
    RadioRecording,
    SimulatedRadio,
    recording_by_time,
    recording_with_marks,
)
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import SenderSettings

NS = 10**9
START_MS = 700_000_000_000
PORT = 8947
TICKS = 30


def contents_of(answer: BridgeAnswer) -> tuple[object, ...]:
    preview = answer.preview
    arrays = (preview.times_s, preview.positions_m, preview.speeds_m_s)
    return (answer.leader, answer.predictor, answer.leader_bound_m, *(a.tobytes() for a in arrays))


def ego_m(route: Route, tick: int) -> float:
    return float(route.leader.positions_at(float(tick))) - 10.0


def drive(wireless: SimulatedRadio, route: Route) -> tuple[list[tuple[object, ...]], object]:
    found = [contents_of(wireless.answer(tick * NS, ego_m(route, tick))) for tick in range(TICKS)]
    return found, wireless.bridge.report()


@pytest.fixture
def traffic(route: Route) -> list[tuple[int, bytes]]:
    """What a lossy link delivers beside noise: arrivals (ns of trip time) in order."""
    faults = {"loss_probability": 0.3, "link_delay_s": 0.2, "link_jitter_s": 0.1}
    sender = CamSender(route.leader, ROAD, SenderSettings(**faults), START_MS)  # type: ignore[arg-type]
    source = random.Random(3)  # noqa: S311 - no secret
    found = []
    for at_ns, datagram in sender.arrivals(-5 * NS, (TICKS - 1) * NS):
        found += [(at_ns, datagram), (at_ns, source.randbytes(40)), (at_ns, datagram)]
    return found


def test_a_recording_with_marks_is_the_drive_itself(
    route: Route, traffic: list[tuple[int, bytes]]
) -> None:
    """The datagrams of a tick are received at it, as in lock-step; ten were dropped by the tenth tick."""
    bridge = CamBridge(ROAD, start_timestamp_ms=START_MS)
    live, stream, sent = [], [], 0
    for tick in range(TICKS):
        for at_ns, datagram in traffic:
            if (tick - 1) * NS < at_ns <= tick * NS or (tick == 0 and at_ns <= 0):
                bridge.receive(datagram, tick * NS)
                stream.append((START_MS * 10**6 + tick * NS, datagram))
                sent += 1
        if tick == 10:
            bridge.count_overflow(10)
            sent += 10
        live.append(contents_of(bridge.answer(tick * NS, ego_m(route, tick))))
        mark = EndOfTick(tick * NS, sent).encode()
        stream += [(START_MS * 10**6 + tick * NS, mark)] * 2  # once more, as after a lost answer
    recording = recording_with_marks(stream, "drive")
    assert recording is not None
    assert recording.start_timestamp_ms == START_MS
    again = SimulatedRadio(recording, CamBridge(ROAD, start_timestamp_ms=START_MS))
    assert drive(again, route) == (live, bridge.report())
    assert bridge.report()["rejected_overflow"] == 10
    # A new trip begins with the first datagram again.
    assert drive(again, route)[0] == live


def test_a_capture_counts_by_the_time_of_reception(
    route: Route, traffic: list[tuple[int, bytes]]
) -> None:
    received = [(START_MS * 10**6 + at_ns, datagram) for at_ns, datagram in traffic]
    recording = recording_by_time(received, START_MS)
    answers, report = drive(
        SimulatedRadio(recording, CamBridge(ROAD, start_timestamp_ms=START_MS)), route
    )
    assert all(answer[0] is not None for answer in answers)
    assert isinstance(report, dict)
    assert report["datagrams"] == len(traffic)
    assert report["leader_station"] == 4711
    # Without a stated time the trip begins with the first datagram.
    first_ms = min(its_ns for its_ns, _ in received) // 10**6
    assert recording_by_time(received, 0).start_timestamp_ms == first_ms


def test_several_trips_in_one_recording_are_refused() -> None:
    stream = [(tick * NS, EndOfTick(tick * NS, 0).encode()) for tick in (0, 1, 2, 0, 1)]
    with pytest.raises(ParameterError, match="one trip"):
        recording_with_marks(stream, "drive")
    assert recording_with_marks([(0, b"no mark")], "drive") is None


def test_an_empty_recording_leads_no_one(route: Route) -> None:
    radio = SimulatedRadio(RadioRecording(0, ()), CamBridge(ROAD))
    assert radio.answer(0, ego_m(route, 0)).leader is None
    assert radio.bridge.table.rejections[Rejection.OVERFLOW] == 0

"""The lead vehicle by the range sensor: which track leads, at which instant, and joined with messages."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.lead_track import RangeTrack
from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.range_sensor import Join, RangeSensorBridge

TICK_NS = 100 * NS_PER_S
EGO_M, EGO_M_S = 1000.0, 20.0


class Messages:
    """A vehicle that is heard at a gap, 2 m of which are its bound, and drives on at 18 m/s."""

    def __init__(self, gap_m: float | None, speed_m_s: float = 18.0) -> None:
        self._gap_m, self._speed_m_s = gap_m, speed_m_s

    def answer(
        self,
        time_ns: int,
        ego_position_m: float,
        ego_speed_m_s: float = 0.0,  # noqa: ARG002
    ) -> BridgeAnswer:
        if self._gap_m is None:
            return BridgeAnswer(time_ns, None, LeaderPreview.empty(), lost=False)
        times = time_ns / NS_PER_S + np.arange(4.0)
        here_m = ego_position_m + self._gap_m
        positions = here_m + self._speed_m_s * np.arange(4.0)
        preview = LeaderPreview(times, positions, np.full(4, self._speed_m_s))
        leader = LeaderState(times[0], here_m - 2.0, self._speed_m_s)
        return BridgeAnswer(time_ns, leader, preview, lost=False, leader_bound_m=2.0)


def answer(
    tracks: tuple[RangeTrack, ...] | None, messages: Messages | None = None, late_ms: int = 0
) -> tuple[BridgeAnswer, Join]:
    bridge = RangeSensorBridge(messages)
    if tracks is not None:
        bridge.take(TICK_NS - late_ms * 1_000_000, tracks)
    found = bridge.answer(TICK_NS, EGO_M, EGO_M_S)
    (join,) = bridge.counts
    return found, join


def test_the_nearest_track_of_the_lane_leads() -> None:
    tracks = (RangeTrack(60.0, 0.5, 1.0), RangeTrack(40.0, -1.0, -2.0), RangeTrack(10.0, 3.5, 0.0))
    found, join = answer(tracks)
    assert found.leader == LeaderState(100.0, 1040.0, 18.0)
    assert found.preview.times_s.size == 0
    assert join is Join.SENSOR


@pytest.mark.parametrize(
    ("late_ms", "gap_m"),
    [(0, 40.0), (50, 39.9), (500, 39.0), (-40, 40.08), (501, None)],
)
def test_a_measurement_is_moved_to_the_tick_and_not_used_when_old(
    late_ms: int, gap_m: float | None
) -> None:
    found, _ = answer((RangeTrack(40.0, 0.0, -2.0),), late_ms=late_ms)
    if gap_m is None:
        assert found.leader is None
    else:
        assert found.leader is not None
        assert found.leader.position_m == pytest.approx(EGO_M + gap_m)


def test_both_agree_and_the_future_is_moved_to_the_measured_place() -> None:
    found, join = answer((RangeTrack(38.5, 0.0, -2.2),), Messages(40.0))
    assert join is Join.AGREED
    assert found.leader == LeaderState(100.0, 1038.5, pytest.approx(17.8))
    assert found.preview.positions_m.tolist() == pytest.approx([1038.5, 1056.5, 1074.5, 1092.5])
    assert not found.contested


@pytest.mark.parametrize(
    ("track", "messages", "join", "gap_m"),
    [
        # A car without radio has cut in; the one that is heard is farther ahead.
        (RangeTrack(20.0, 0.0, 0.0), Messages(60.0), Join.SENSOR_NEARER, 20.0),
        # The same place, but a speed that cannot be: measured, it stands.
        (RangeTrack(38.0, 0.0, -20.0), Messages(40.0), Join.SENSOR_NEARER, 38.0),
        # The sensor sees past a vehicle that is heard nearer, at 30 m less its bound.
        (RangeTrack(80.0, 0.0, 0.0), Messages(30.0), Join.MESSAGES_NEARER, 28.0),
        (None, Messages(30.0), Join.MESSAGES, 28.0),
        (RangeTrack(50.0, 0.0, 0.0), Messages(None), Join.SENSOR, 50.0),
        (None, Messages(None), Join.NEITHER, None),
    ],
)
def test_a_contradiction_has_a_name_and_the_nearer_one_leads(
    track: RangeTrack | None, messages: Messages, join: Join, gap_m: float | None
) -> None:
    found, named = answer(() if track is None else (track,), messages)
    assert named is join
    assert found.contested is ("contradiction" in join.value)
    assert (found.leader and found.leader.position_m - EGO_M) == gap_m


def test_measurements_of_the_first_tick_may_come_before_the_trip() -> None:
    early = RangeSensorBridge()
    early.take(TICK_NS, (RangeTrack(40.0, 0.0, 0.0),))
    bridge = RangeSensorBridge(before=early)
    assert bridge.has_measured(TICK_NS)
    assert not bridge.has_measured(TICK_NS + 1)
    assert bridge.answer(TICK_NS, EGO_M, EGO_M_S).leader is not None

"""The chain of vehicles ahead: which vehicle counts, what the answer is then, and how it falls back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import NS, ROAD, datagram

from iptm_core.lead_track import RangeTrack
from iptm_core.road_ahead import SpeedLimits
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_its.chain import LONGEST_CHAIN, ChainBridge, ChainSource
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal
from iptm_v2x_bridge.range_sensor import Join, RangeSensorBridge

SPEED_M_S, GAP_M, LENGTH_M = 20.0, 40.0, 4.5
BETWEEN_M = 32.0
SETTINGS = PreviewSettings()


class Drive:
    """An ego vehicle at 20 m/s behind a leader, and the vehicles ahead of it."""

    def __init__(
        self, *, hears: bool = False, rules: tuple[RoadRules, RoadRules] | None = None
    ) -> None:
        self.messages = CamBridge(ROAD, SETTINGS) if hears else None
        self.sensor = RangeSensorBridge(self.messages)
        self.chain = ChainBridge(
            self.sensor, SETTINGS, sensor=self.sensor, messages=self.messages, rules=rules
        )
        self.second = 0

    def tick(self, *tracks: RangeTrack) -> BridgeAnswer:
        time_ns = self.second * NS
        self.sensor.take(time_ns, tracks)
        found = self.chain.answer(time_ns, self.ego_m, SPEED_M_S)
        self.second += 1
        return found

    @property
    def ego_m(self) -> float:
        return SPEED_M_S * self.second

    def hear(self, identity: int, gap_m: float, speed_m_s: float = SPEED_M_S, **more: Any) -> None:
        """Four messages in the second before the tick of now, of a car whose rear is that far ahead."""
        assert self.messages is not None
        for before_ms in (750, 500, 250, 0):
            sent_ms = 1000 * self.second - before_ms
            if sent_ms >= 0:
                rear_m = self.ego_m + gap_m - speed_m_s * before_ms / 1000.0
                bits = datagram(identity, sent_ms, rear_m, speed_m_s, **more)
                self.messages.receive(bits, sent_ms * 1_000_000)


LEADER = RangeTrack(GAP_M, 0.0, 0.0)
SECOND = RangeTrack(GAP_M + LENGTH_M + BETWEEN_M, 0.0, 0.0)


def test_the_second_track_gives_a_preview_after_a_second() -> None:
    drive = Drive()
    assert drive.tick(LEADER, SECOND).preview.times_s.size == 0
    found = drive.tick(LEADER, SECOND)
    assert found.predictor == "car_following"
    assert found.preview.times_s[0] == 1.0
    assert found.preview.positions_m[0] == pytest.approx(SPEED_M_S + GAP_M)
    assert found.preview.positions_m[2] == pytest.approx(SPEED_M_S + GAP_M + 40.0, abs=0.5)
    assert found.preview.bounds_m[0] == 0.0
    assert np.diff(found.preview.bounds_m).min() >= 0.0
    assert found.preview.times_s[-1] == 1.0 + SETTINGS.preview_length_s


def test_a_leader_is_expected_to_brake_behind_a_vehicle_that_brakes() -> None:
    drive, steady = Drive(), Drive()
    for lost_m_s in (0.0, 0.0, 0.0, 2.0):
        nearer_m = 0.5 * lost_m_s
        found = drive.tick(
            LEADER, SECOND._replace(gap_m=SECOND.gap_m - nearer_m, relative_speed_m_s=-lost_m_s)
        )
        usual = steady.tick(LEADER, SECOND)
    assert usual.preview.positions_m[5] - found.preview.positions_m[5] > 5.0


@pytest.mark.parametrize(
    "second",
    [
        (),
        (SECOND._replace(left_m=3.5),),
        (SECOND._replace(gap_m=GAP_M + 3.0),),
        (SECOND._replace(gap_m=SECOND.gap_m - 12.0),),
    ],
    ids=["lost", "another lane", "inside the leader", "cut-in"],
)
def test_it_falls_back_within_a_tick(second: tuple[RangeTrack, ...]) -> None:
    drive, alone = Drive(), RangeSensorBridge()
    for _ in range(5):
        found = drive.tick(LEADER, SECOND)
    assert found.predictor == "car_following"
    now_ns, ego_m = drive.second * NS, drive.ego_m
    alone.take(now_ns, (LEADER, *second))
    found, usual = drive.tick(LEADER, *second), alone.answer(now_ns, ego_m, SPEED_M_S)
    assert found.leader == usual.leader
    assert found.preview.times_s.size == usual.preview.times_s.size == 0


def test_a_new_leader_has_no_past() -> None:
    drive = Drive()
    for _ in range(5):
        drive.tick(LEADER, SECOND)
    assert drive.tick(LEADER._replace(gap_m=20.0), LEADER).predictor == ""


def test_without_previews_nothing_is_completed() -> None:
    settings = replace(SETTINGS, preview_mode=PreviewMode.NONE)
    sensor = RangeSensorBridge()
    chain = ChainBridge(sensor, settings, sensor=sensor)
    for second in range(3):
        sensor.take(second * NS, (LEADER, SECOND))
        found = chain.answer(second * NS, SPEED_M_S * second, SPEED_M_S)
        assert found.preview.times_s.size == 0


def test_a_message_of_the_vehicle_ahead_of_an_unequipped_leader_counts() -> None:
    """Until now it was taken to contradict the sensor."""
    drive = Drive(hears=True)
    for _ in range(4):
        drive.hear(7, SECOND.gap_m)
        found = drive.tick(LEADER)
    assert drive.sensor.counts[Join.SENSOR_NEARER] > 0
    assert found.predictor == "car_following"
    assert not found.contested
    (ahead,) = drive.chain.chain
    assert ahead.source is ChainSource.MESSAGES
    assert ahead.position_m == pytest.approx(SPEED_M_S * 3 + SECOND.gap_m, abs=0.1)


def test_the_sensor_overrules_a_message() -> None:
    """A station that claims a place between leader and second track, and brakes, changes nothing."""
    drive, honest = Drive(hears=True), Drive()
    for second in range(6):
        drive.hear(7, GAP_M + LENGTH_M + 10.0, SPEED_M_S - second)
        found, usual = drive.tick(LEADER, SECOND), honest.tick(LEADER, SECOND)
    assert drive.chain.counts["contradicted"] > 0
    np.testing.assert_array_equal(found.preview.positions_m, usual.preview.positions_m)


def test_a_leader_that_does_not_follow_is_not_forecast_by_what_is_ahead() -> None:
    """The claimed vehicle brakes with 2 m/s², the leader does not."""
    drive = Drive(hears=True)
    gap_m, speed_m_s, predictors = SECOND.gap_m, SPEED_M_S, []
    for second in range(11):
        drive.hear(7, gap_m, speed_m_s)
        predictors.append(drive.tick(LEADER).predictor)
        slower_m_s = speed_m_s - (2.0 if second >= 3 else 0.0)
        gap_m, speed_m_s = gap_m + 0.5 * (speed_m_s + slower_m_s) - SPEED_M_S, slower_m_s
    assert predictors[3] == "car_following"
    assert drive.chain.counts["doubted"] == 1
    assert predictors[-1] != "car_following"


def test_a_claim_never_widens_what_limits_hold_for() -> None:
    """The lowest position is never farther than with the leader alone."""
    drive = Drive(hears=True)
    for second in range(4):
        drive.hear(7, SECOND.gap_m + 5.0 * second, SPEED_M_S + 5.0)
        found = drive.tick(LEADER)
    assert found.predictor == "car_following"
    lowest_m = found.preview.cautious().positions_m
    elapsed_s = found.preview.times_s - found.preview.times_s[0]
    assert np.all(lowest_m <= found.preview.positions_m[0] + SPEED_M_S * elapsed_s + 1e-9)


@pytest.mark.parametrize(
    ("gap_m", "more"),
    [
        (SECOND.gap_m, {"left_m": 3.5}),
        (SECOND.gap_m, {"heading_deg": 180.0}),
        (0.0, {}),
        (GAP_M, {}),
        (GAP_M + 260.0, {}),
    ],
    ids=["another lane", "oncoming", "own position", "the leader", "far ahead"],
)
def test_what_is_not_ahead_of_the_leader_does_not_count(gap_m: float, more: dict[str, Any]) -> None:
    drive = Drive(hears=True)
    for _ in range(4):
        drive.hear(7, gap_m, **more)
        found = drive.tick(LEADER)
    assert not drive.chain.chain
    assert found.predictor != "car_following"


def test_a_message_that_repeats_itself_is_not_followed() -> None:
    """The same octets again and again: after a second and a half the station is silent."""
    drive = Drive(hears=True)
    for _ in range(3):
        drive.hear(7, SECOND.gap_m)
        drive.tick(LEADER)
    assert drive.messages is not None
    for _ in range(3):
        stale = datagram(7, 2000, 2.0 * SPEED_M_S + SECOND.gap_m, SPEED_M_S)
        drive.messages.receive(stale, drive.second * NS)
        found = drive.tick(LEADER)
    assert not drive.chain.chain
    assert found.predictor == ""
    assert drive.messages.table.rejections.by_reason()


def test_memory_is_bounded_with_a_hundred_stations() -> None:
    drive = Drive(hears=True)
    for _ in range(4):
        for identity in range(100):
            drive.hear(identity, SECOND.gap_m + 10.0 * identity)
        drive.tick(LEADER, SECOND)
    assert len(drive.chain.chain) == LONGEST_CHAIN
    assert len(drive.chain._stations) <= LONGEST_CHAIN


def test_identities_that_contradict_themselves_do_not_count() -> None:
    drive = Drive(hears=True)
    for _ in range(12):
        drive.hear(7, SECOND.gap_m)
        drive.hear(7, SECOND.gap_m + 60.0)
        found = drive.tick(LEADER)
    assert found.predictor == ""
    assert not drive.chain.chain


def red_at(position_m: float, opens_s: float) -> RoadRules:
    return RoadRules(None, (Signal(position_m, ((0.0, opens_s),)),))


def test_a_leader_stops_at_a_red_that_is_announced() -> None:
    rules = red_at(300.0, 60.0)
    drive = Drive(rules=(rules, rules))
    for _ in range(4):
        found = drive.tick(LEADER)
    assert found.predictor == "signals"
    last_m = found.preview.at(np.array([20.0]))[0][0]
    assert last_m <= 300.0 - LENGTH_M
    assert found.preview.at(np.array([20.0]))[1][0] < 3.0


@pytest.mark.parametrize(
    ("limits", "predictor"),
    [
        (((0.0, 30.0),), ""),
        (((0.0, 30.0), (180.0, 10.0)), "signals"),
        (((0.0, 30.0), (600.0, 10.0)), ""),
    ],
    ids=["faster", "slower in 6 s", "slower in 28 s"],
)
def test_rules_count_where_they_move_the_leader_within_ten_seconds(
    limits: tuple[tuple[float, float], ...], predictor: str
) -> None:
    starts_m, speeds_m_s = np.array(limits).T
    rules = RoadRules(SpeedLimits(starts_m, speeds_m_s))
    drive = Drive(rules=(rules, rules))
    for _ in range(3):
        found = drive.tick(LEADER)
    assert found.predictor == predictor
    assert bool(found.preview.times_s.size) is bool(predictor)


def test_a_phase_that_is_not_sure_is_a_spread() -> None:
    """Likely to open at 2 s, sure to be open from 60 s on: the bound reaches back to the line."""
    sure, likely = red_at(300.0, 60.0), red_at(300.0, 2.0)
    drive = Drive(rules=(likely, sure))
    for _ in range(4):
        found = drive.tick(LEADER)
    at_s = int(np.searchsorted(found.preview.times_s, 16.0))
    assert found.preview.positions_m[at_s] > 300.0
    assert found.preview.positions_m[at_s] - found.preview.bounds_m[at_s] <= 300.0

"""The monitor behind range sensors that fall silent, freeze or see nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_plant_sim.scenes import COAST, MONITOR, SETTINGS, driving, lead_at

from iptm_core.lead_track import LeadStatus, LeadTrack, Sample, clear_lane, followed
from iptm_core.state import LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.lead_measurements import LeadMeasurements, plainly_followed


def still(after_s: float) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, 0.0


def measured(*rows: tuple[float, float, float]) -> LeaderPreview:
    return LeaderPreview(*np.array(rows, dtype=float).reshape(-1, 3).T)


def test_a_vehicle_brakes_as_hard_as_it_can_from_the_first_measurement_that_is_missing() -> None:
    track = LeadMeasurements(LeadTrack(), measured((0.0, 50.0, 20.0)), still, 0.0).track
    known = LeadMeasurements(track, measured((1.0, 68.0, 16.0)), still, 1.0)
    assert known.at(1.0, 9.0) == (LeaderState(1.0, 68.0, 16.0), 0.0, True)
    lead, unseen_s, is_measured = known.at(1.5, 9.0)
    assert (lead, unseen_s, is_measured) == (LeaderState(1.5, 68.0 + 8.0 - 0.5, 14.0), 0.0, False)
    silent = LeadMeasurements(known.track, None, still, 2.0)
    # One measurement per second: the next one is missing from 2 s on, at 82 m and 12 m/s. Then 9 m/s^2.
    lead, unseen_s, _ = silent.at(3.0, 9.0)
    assert lead == LeaderState(3.0, pytest.approx(82.0 + 12.0 - 4.5), pytest.approx(3.0))
    assert unseen_s == pytest.approx(1.0)
    lead, _, _ = silent.at(60.0, 9.0)
    assert lead == LeaderState(60.0, pytest.approx(82.0 + 144.0 / 18.0), 0.0)


def test_hard_braking_shows_in_two_steps_across_the_start_of_an_interval() -> None:
    before = LeadMeasurements(
        LeadTrack(), measured((0.8, 50.0, 20.0), (0.9, 52.0, 20.0)), still, 0.0
    ).track
    once = LeadMeasurements(before, measured((1.0, 53.95, 19.0)), still, 1.0)
    assert not once.brakes_harder_than(9.0)
    for last_m_s, harder in ((18.2, False), (18.0, True)):
        twice = LeadMeasurements(once.track, measured((1.1, 55.8, last_m_s)), still, 1.1)
        assert twice.brakes_harder_than(9.0) is harder
        assert twice.shown_deceleration_m_s2(1.1) == pytest.approx(10.0 * (19.0 - last_m_s))


def test_the_smallest_gap_counts_what_is_measured_later() -> None:
    """Own motion 20 m/s from the start of the interval on: gaps of 50, 46 and 48 m."""
    rows = measured((1.0, 50.0, 20.0), (1.5, 56.0, 12.0), (2.0, 68.0, 24.0))
    leads = LeadMeasurements(LeadTrack(), rows, lambda after_s: (20.0 * after_s, 20.0), 1.0)
    for after_s, expected_m in ((0.5, 46.0), (1.0, 46.0), (1.5, 48.0)):
        assert leads.smallest_gap_m(after_s) == pytest.approx(expected_m)
    assert math.isnan(leads.smallest_gap_m(2.0))


def test_an_empty_lane_is_free_when_it_has_been_empty_for_long_or_a_source_reports_it() -> None:
    track = LeadMeasurements(LeadTrack(), measured((0.0, 50.0, 20.0)), still, 0.0).track
    for now_s in range(1, 11):
        leads = LeadMeasurements(track, LeaderPreview.empty(), still, float(now_s))
        lead, _, _ = leads.at(now_s + 0.5, 9.0)
        assert lead is not None, f"lost at {now_s} s, not free"
        track = leads.track
    gone = LeadMeasurements(track, LeaderPreview.empty(), still, 11.0)
    assert gone.at(11.0, 9.0) == (None, 0.0, False)
    clear = LeadMeasurements(track, clear_lane(5.0), still, 5.0)
    assert clear.at(5.0, 9.0) == (None, 0.0, False)
    assert clear.bounds() is None


def test_a_frozen_sensor_is_worse_than_a_silent_one_only_until_its_third_measurement() -> None:
    plant, state = driving(20.0)
    sound = lead_at(60.0, 20.0)
    frozen = sound(replace(state, time_s=0.9))

    def sensor(now: VehicleState) -> LeaderPreview:
        if now.time_s < 1.0:
            return sound(now)
        times = now.time_s + 0.1 * np.arange(10)
        gap_m = float(frozen.positions_m[0]) - 18.0
        return LeaderPreview(times, np.full(10, now.position_m + gap_m), np.full(10, 20.0))

    plant.watch(sensor)
    for _ in range(2):
        step = plant.advance(state, COAST)
        state = step.state
    assert step.memory.lead.status(2.0) is LeadStatus.FROZEN
    assert step.memory.lead.seen == LeaderState(1.0, pytest.approx(80.0), 20.0)
    while state.speed_m_s > 0.0 and state.time_s < 30.0:
        step = plant.advance(state, COAST)
        state = step.state
    # It would stop 0.1 s and 20^2 / 18 m farther on, if it began to brake at once.
    assert state.position_m < 80.0 + 2.0 + 400.0 / 18.0 - SETTINGS.monitor_margin_m


def test_the_gap_grows_behind_a_sensor_that_falls_silent() -> None:
    plant, state = driving(20.0)
    gap = MONITOR.safe_distance_m(20.0, 0.0, 20.0) + 10.0
    sensor = lead_at(gap, 20.0)
    plant.watch(lambda state: sensor(state) if state.time_s < 1.5 else None)
    braked_s = 0.0
    for _ in range(6):
        step = plant.advance(state, COAST)
        braked_s += step.safety.service_braking_s
        state = step.state
    assert braked_s > 0.0
    assert state.speed_m_s < 20.0


def test_without_a_vehicle_ahead_it_does_not_brake() -> None:
    plant, state = driving(30.0)
    plant.watch(lambda _: LeaderPreview.empty())
    step = plant.advance(state, COAST)
    assert step.safety.service_braking_s == 0.0
    assert math.isnan(step.safety.smallest_gap_m)


@given(
    st.lists(st.sampled_from([0.0, 0.3, 5.0, 6.1, 12.0]), min_size=9, max_size=9),
    st.lists(st.sampled_from([0.0, 0.0, 0.0, 1e-7, 0.5, -4.0]), min_size=9, max_size=9),
    st.floats(0.0, 20.0),
)
def test_plain_measurements_are_followed_at_once_as_one_by_one(
    changes_m_s: list[float], jumps_m: list[float], own_m_s: float
) -> None:
    samples, position_m = [Sample(0.0, 30.0, 5.0, 0.0, own_m_s)], 30.0
    for number, (change, jump) in enumerate(zip(changes_m_s, jumps_m, strict=True), start=1):
        speed = 0.1 * change + 0.01 * number * (change > 1.0)
        position_m += 0.05 * (samples[-1].speed_m_s + speed) + jump
        own_m = 0.1 * number * own_m_s
        samples.append(Sample(0.1 * number, position_m, speed, own_m, own_m_s))
    sound = reduce(followed, samples[:4], LeadTrack())
    for before in (replace(sound, frozen=True), sound):
        at_once = plainly_followed(before, samples[4:])
        one_by_one = replace(reduce(followed, samples[4:], before), empty_since_s=math.nan)
        assert at_once is None or at_once == one_by_one
    if not any(jumps_m) and len(set(changes_m_s)) == 1 and changes_m_s[0] > 1.0 and own_m_s < 0.4:
        assert at_once is not None


@pytest.mark.parametrize(
    ("farther_m", "plain"), [(0.0, True), (1.2, True), (1.5, False), (4.0, False)]
)
def test_a_jump_and_a_gap_that_its_speed_does_not_explain_need_a_closer_look(
    farther_m: float, plain: bool
) -> None:
    """At 20 m/s it moves by 2 m in 0.1 s; 1.2 m may be left unexplained."""
    before = [Sample(0.1 * n, 50.0 + 2.0 * n, 20.0, 0.01 * n, 0.1) for n in range(3)]
    track = reduce(followed, before, LeadTrack())
    last = Sample(0.3, 56.0 + farther_m, 20.0, 0.03, 0.1)
    assert (plainly_followed(track, [last]) is not None) is plain


def test_one_measurement_does_not_bound_an_interval() -> None:
    before = LeadMeasurements(LeadTrack(), measured((0.0, 50.0, 20.0)), still, 0.0).track
    rows = (0.1, 51.98, 19.6), (0.2, 53.92, 19.2)
    one, two = (LeadMeasurements(before, measured(*rows[:n]), still, 0.1) for n in (1, 2))
    assert one.bounds() is None
    assert two.bounds() == (51.98, 19.2)

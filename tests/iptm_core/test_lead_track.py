"""The track of the vehicle ahead: frozen within three measurements, lost is not free, and no false alarm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.lead_track import (
    CONFIRMED_FREE_S,
    LONGEST_PERIOD_S,
    LeadStatus,
    LeadTrack,
    Sample,
    clear_lane,
    emptied,
    followed,
    resolution,
    slowed,
)
from iptm_core.state import LeaderState


def track_of(samples: Iterable[Sample]) -> LeadTrack:
    track = LeadTrack()
    for sample in samples:
        track = followed(track, sample)
    return track


def driven(
    seconds: float,
    period_s: float,
    lead: Callable[[float], tuple[float, float]],
    own: Callable[[float], tuple[float, float]],
) -> list[Sample]:
    times = np.arange(0.0, seconds, period_s).tolist()
    return [Sample(time_s, *lead(time_s), *own(time_s)) for time_s in times]


def cruising(position_m: float, speed_m_s: float) -> Callable[[float], tuple[float, float]]:
    return lambda time_s: (position_m + speed_m_s * time_s, speed_m_s)


def swaying(time_s: float) -> tuple[float, float]:
    """Return an own vehicle whose speed sways by 0.5 m/s around 20 m/s."""
    return 20.0 * time_s + 0.5 * (1.0 - math.cos(time_s)), 20.0 + 0.5 * math.sin(time_s)


def test_a_sound_sensor_is_followed_measurement_by_measurement() -> None:
    samples = driven(5.0, 0.1, cruising(40.0, 18.0), swaying)
    track = track_of(samples)
    assert track.seen == samples[-1].lead
    assert track.status(samples[-1].time_s) is LeadStatus.MEASURED
    assert track.status(samples[-1].time_s + 0.1) is LeadStatus.MEASURED, "the next one is not due"
    assert track.status(samples[-1].time_s + 0.3) is LeadStatus.LOST
    assert track.unseen_s(samples[-1].time_s + 0.3) == pytest.approx(0.2)


@pytest.mark.parametrize("period_s", [0.1, 1.0])
def test_a_gap_that_stays_while_the_own_speed_changes_is_frozen_within_three_measurements(
    period_s: float,
) -> None:
    samples = driven(10.0 * period_s, period_s, cruising(40.137, 19.973), cruising(0.0, 20.0))
    before = samples[-1]
    track = track_of(samples)
    frozen_after = 0
    for number in range(1, 4):
        time_s = before.time_s + number * period_s
        own_m_s = 20.0 - 2.0 * number * period_s
        own_m = before.own_position_m + 20.0 * number * period_s - (number * period_s) ** 2
        gap_m = before.position_m - before.own_position_m
        track = followed(track, Sample(time_s, own_m + gap_m, 19.973, own_m, own_m_s))
        if track.frozen:
            frozen_after = number
            break
    assert frozen_after in {2, 3}
    assert track.seen is not None
    assert track.seen.time_s <= before.time_s + 1e-9 + period_s
    assert track.status(time_s) is LeadStatus.FROZEN


def test_a_position_that_stays_under_a_moving_vehicle_is_frozen() -> None:
    samples = driven(2.0, 0.1, cruising(40.0, 20.0), swaying)
    held = samples[-1]
    repeated = [
        Sample(held.time_s + 0.1 * n, held.position_m, 20.0, *swaying(held.time_s + 0.1 * n))
        for n in (1, 2)
    ]
    track = track_of(samples)
    track = followed(track, repeated[0])
    assert not track.frozen, "one repetition proves nothing"
    track = followed(track, repeated[1])
    assert track.frozen
    assert track.seen == held.lead
    lead = track.assumed_at(held.time_s + 1.1, 9.0)
    assert lead is not None
    assert lead.speed_m_s == pytest.approx(20.0 - 9.0 * 1.0), (
        "it brakes from the first repetition on"
    )


def test_a_frozen_sensor_counts_again_when_its_measurements_move_as_they_should() -> None:
    samples = driven(2.0, 0.1, cruising(40.0, 20.0), swaying)
    held = samples[-1]
    track = track_of(samples)
    for n in range(1, 6):
        now_s = held.time_s + 0.1 * n
        track = followed(track, Sample(now_s, held.position_m, 20.0, *swaying(now_s)))
    assert track.frozen
    later = [held.time_s + 0.1 * n for n in range(6, 9)]
    states = []
    for now_s in later:
        after_s = now_s - held.time_s
        lead = 30.0 + 15.0 * now_s - 0.25 * after_s**2, 15.0 - 0.5 * after_s
        track = followed(track, Sample(now_s, *lead, *swaying(now_s)))
        states.append(track.frozen)
    assert states == [True, True, False], "two steps that agree with the speed"
    assert track.acceleration_m_s2 == pytest.approx(-0.5)


@pytest.mark.parametrize(("speed_m_s", "frozen"), [(15.0, True), (0.4, False)])
def test_a_position_that_stays_frees_a_frozen_sensor_only_under_a_standing_vehicle(
    speed_m_s: float, frozen: bool
) -> None:
    samples = driven(2.0, 0.1, cruising(40.0, 20.0), swaying)
    held = samples[-1]
    track = track_of(samples)
    for n in range(1, 6):
        now_s = held.time_s + 0.1 * n
        track = followed(track, Sample(now_s, held.position_m, 20.0, *swaying(now_s)))
    assert track.frozen
    for n in range(6, 12):
        now_s = held.time_s + 0.1 * n
        slower_m_s = speed_m_s - 0.01 * n
        track = followed(track, Sample(now_s, held.position_m, slower_m_s, *swaying(now_s)))
    assert track.frozen is frozen


@pytest.mark.parametrize(("later_s", "ghost"), [(2.0, True), (3.0, True), (4.0, False)])
def test_only_what_has_just_appeared_is_a_ghost_when_it_moves_away(
    later_s: float, ghost: bool
) -> None:
    """A slow vehicle appears at 3 s, and is 12 m farther than its speed implies some seconds later."""
    samples = driven(3.0, 1.0, cruising(80.0, 20.0), cruising(0.0, 20.0))
    track = track_of(samples)
    for time_s in np.arange(3.0, 3.0 + later_s).tolist():
        lead = 160.0 + 10.0 * (time_s - 3.0), 10.0
        track = followed(track, Sample(time_s, *lead, 20.0 * time_s, 20.0))
        assert not track.frozen
    now_s = 3.0 + later_s
    away = Sample(now_s, 172.0 + 10.0 * later_s, 10.0, 20.0 * now_s, 20.0)
    track = followed(track, away)
    assert (track.frozen, track.ghost) == (ghost, ghost)
    assert track.seen == (samples[-1].lead if ghost else away.lead)


def test_a_vehicle_that_appears_with_a_frozen_measurement_has_never_been_there() -> None:
    samples = driven(3.0, 1.0, cruising(60.0, 20.0), swaying)
    track = track_of(samples)
    for time_s in (3.0, 4.0):
        own_m, own_m_s = swaying(time_s)
        track = followed(track, Sample(time_s, own_m + 15.0, 0.0, own_m, own_m_s))
        if time_s == 3.0:
            assert track.seen == LeaderState(3.0, own_m + 15.0, 0.0), (
                "a vehicle that cuts in counts"
            )
    assert track.frozen, "standing, and yet 20 m farther on"
    assert track.seen == samples[-1].lead


@given(
    st.floats(0.0, 35.0),
    st.floats(0.0, 35.0),
    st.sampled_from([0.0, 0.01, 0.1, 0.25, 0.5, 1.0]),
    st.sampled_from([0.0, 0.1, 0.5]),
    st.sampled_from([0.1, 1.0]),
)
def test_neither_even_driving_nor_rounding_looks_frozen(
    own_m_s: float, lead_m_s: float, gap_step_m: float, speed_step_m_s: float, period_s: float
) -> None:
    def rounded(value: float, step: float) -> float:
        return step * round(value / step) if step else value

    track = LeadTrack()
    for time_s in np.arange(0.0, 20.0 * period_s, period_s).tolist():
        own_m = own_m_s * time_s
        gap_m = rounded(700.0 + (lead_m_s - own_m_s) * time_s, gap_step_m)
        speed_m_s = rounded(lead_m_s, speed_step_m_s)
        track = followed(track, Sample(time_s, own_m + gap_m, speed_m_s, own_m, own_m_s))
        assert not track.frozen


def test_a_coarse_sensor_that_follows_evenly_does_not_look_frozen() -> None:
    track = LeadTrack()
    for time_s in range(12):
        own_m = 20.1 * time_s
        sample = Sample(float(time_s), own_m + 50.0, 20.0, own_m, 20.1)
        track = followed(track, sample)
        assert not track.frozen, "20.1 m/s in steps of 0.5 m/s, the gap in steps of 1 m"


def test_an_empty_lane_is_lost_until_it_is_confirmed() -> None:
    track = track_of(driven(2.0, 1.0, cruising(40.0, 20.0), swaying))
    for time_s in np.arange(2.0, 2.0 + CONFIRMED_FREE_S, 1.0).tolist():
        track = emptied(track, time_s)
        assert track.status(time_s + 0.5) is LeadStatus.LOST
    assert emptied(track, 2.0 + CONFIRMED_FREE_S).status(20.0) is LeadStatus.FREE
    assert emptied(LeadTrack(), 5.0).status(5.0) is LeadStatus.FREE, "a vehicle that never was"


def test_a_measurement_interrupts_the_confirmation() -> None:
    lead = cruising(40.0, 20.0)
    track = track_of(driven(2.0, 1.0, lead, swaying))
    for time_s in np.arange(2.0, 8.0, 1.0).tolist():
        track = emptied(track, time_s)
    track = followed(track, Sample(8.0, *lead(8.0), *swaying(8.0)))
    assert track.status(8.0) is LeadStatus.MEASURED
    assert emptied(track, 13.0).status(13.0) is LeadStatus.LOST


def test_a_source_that_sees_a_clear_lane_frees_it_at_once() -> None:
    track = track_of(driven(2.0, 1.0, cruising(40.0, 20.0), swaying))
    clear = clear_lane(2.0)
    sample = Sample(2.0, float(clear.positions_m[0]), float(clear.speeds_m_s[0]), 40.0, 20.0)
    assert followed(track, sample).status(2.0) is LeadStatus.FREE
    assert followed(track, sample).assumed_at(3.0, 9.0) is None


def test_what_has_been_measured_goes_on_with_its_deceleration_until_the_next_one_is_due() -> None:
    track = track_of([Sample(0.0, 50.0, 20.0, 0.0, 20.0), Sample(1.0, 68.0, 16.0, 20.0, 20.0)])
    assert track.acceleration_m_s2 == -4.0
    assert track.assumed_at(1.5, 9.0) == LeaderState(1.5, 75.5, 14.0)
    # Due at 2 s: 82 m, 12 m/s; then 9 m/s^2 for 1 s.
    assert track.assumed_at(3.0, 9.0) == LeaderState(3.0, 89.5, 3.0)
    faster = track_of([Sample(0.0, 50.0, 16.0, 0.0, 20.0), Sample(1.0, 68.0, 20.0, 20.0, 20.0)])
    assert faster.assumed_at(2.0, 9.0) == LeaderState(2.0, 88.0, 20.0), (
        "it is not relied on to go faster"
    )


def test_two_steps_show_how_hard_a_vehicle_brakes() -> None:
    speeds = ((20.0, 0.0), (19.6, 0.0), (19.0, 4.0), (18.5, 5.0), (18.6, 0.0), (18.0, 0.0))
    track, position_m = LeadTrack(), 50.0
    for index, (speed_m_s, shown_m_s2) in enumerate(speeds):
        track = followed(track, Sample(0.1 * index, position_m, speed_m_s, 2.0 * index, 20.0))
        assert track.shown_deceleration_m_s2 == pytest.approx(shown_m_s2), index
        position_m += 0.1 * speed_m_s


def test_another_vehicle_and_another_trip_begin_without_a_past() -> None:
    track = track_of([Sample(5.0, 50.0, 20.0, 0.0, 20.0), Sample(6.0, 40.0, 5.0, 20.0, 20.0)])
    assert track.acceleration_m_s2 == 0.0
    assert track.before == LeaderState(5.0, 50.0, 20.0)
    again = followed(track, Sample(0.0, 15.0, 0.0, 0.0, 0.0))
    assert again.recent == (Sample(0.0, 15.0, 0.0, 0.0, 0.0),)
    far = track_of([Sample(0.0, 50.0, 20.0, 0.0, 20.0), Sample(6.0, 170.0, 20.0, 120.0, 20.0)])
    assert far.period_s == LONGEST_PERIOD_S
    assert far.acceleration_m_s2 == 0.0, "too long ago for an acceleration"


@pytest.mark.parametrize(
    ("step_m", "change_m_s", "is_another"),
    [
        (2.9, 0.0, False),
        (3.1, 0.0, True),
        (-2.9, 0.0, False),
        (-3.1, 0.0, True),
        (0.0, 4.1, False),
        (0.0, 4.3, True),
        (0.0, -4.1, False),
        (0.0, -4.3, True),
    ],
)
def test_a_step_that_no_vehicle_makes_is_another_one(
    step_m: float, change_m_s: float, *, is_another: bool
) -> None:
    """More than 3 m, or than 3 m/s and 12 m/s^2 in the 0.1 s between two measurements."""
    track = followed(LeadTrack(), Sample(0.0, 40.0, 20.0, 0.0, 20.0))
    moved_m = step_m + 0.1 * (20.0 + 0.5 * change_m_s)
    track = followed(track, Sample(0.1, 40.0 + moved_m, 20.0 + change_m_s, 2.0, 20.0))
    assert (track.before is not None) is is_another


@pytest.mark.parametrize(("change_m_s", "is_away"), [(0.9, True), (1.1, False), (-0.9, True)])
def test_a_vehicle_that_jumps_away_at_its_speed_counts_as_nearer(
    change_m_s: float, *, is_away: bool
) -> None:
    track = LeadTrack()
    for tick in range(40):
        time_s = 0.1 * tick
        track = followed(
            track, Sample(time_s, 40.0 + 20.0 * time_s, 20.0, 19.0 * time_s, 19.0 + 0.01 * tick)
        )
    step = Sample(4.0, 40.0 + 80.0 + 6.0, 20.0 + change_m_s, 76.0, 19.4)
    track = followed(track, step)
    assert (track.away_m > 0.0) is is_away
    for after_s, counts in ((19.9, is_away), (20.1, False)):
        later = 126.0 + step.speed_m_s * after_s, step.speed_m_s
        own = 76.0 + 19.4 * after_s, 19.4
        seen = followed(track, Sample(4.0 + after_s, *later, *own))
        assert (seen.away_m > 0.0) is counts


@pytest.mark.parametrize(
    ("interval_s", "acceleration_m_s2", "period_s"),
    [(1.4, 0.5, 1.4), (1.6, 0.5, 1.5), (4.9, 0.5, 1.5), (5.1, 0.0, 1.5)],
)
def test_measurements_far_apart_show_no_acceleration_and_are_due_within_1_5_s(
    interval_s: float, acceleration_m_s2: float, period_s: float
) -> None:
    track = followed(LeadTrack(), Sample(0.0, 40.0, 20.0, 0.0, 20.0))
    speed_m_s = 20.0 + 0.5 * interval_s
    moved_m = 0.5 * (20.0 + speed_m_s) * interval_s
    own_m = 20.0 * interval_s
    track = followed(track, Sample(interval_s, 40.0 + moved_m, speed_m_s, own_m, 20.0))
    assert track.acceleration_m_s2 == pytest.approx(acceleration_m_s2)
    assert track.period_s == period_s


def test_a_vehicle_at_no_distance_that_matters_is_none() -> None:
    track = followed(LeadTrack(), Sample(0.0, 40.0, 20.0, 0.0, 20.0))
    assert followed(track, Sample(0.1, 1e9, 0.0, 2.0, 20.0)).seen is None
    assert followed(track, Sample(0.1, 0.99e9, 0.0, 2.0, 20.0)).seen is not None


def test_a_measurement_of_the_same_instant_replaces_the_one_before() -> None:
    track = track_of([Sample(0.0, 50.0, 20.0, 0.0, 20.0), Sample(1.0, 70.0, 20.0, 20.0, 20.0)])
    corrected = followed(track, Sample(1.0, 69.0, 19.0, 20.0, 20.0))
    assert corrected.seen == LeaderState(1.0, 69.0, 19.0)
    assert len(corrected.recent) == 2


def test_a_vehicle_that_brakes_stands_at_the_end_of_its_way() -> None:
    assert slowed(LeaderState(0.0, 10.0, 6.0), 3.0, 1.0) == LeaderState(1.0, 14.5, 3.0)
    assert slowed(LeaderState(0.0, 10.0, 6.0), 3.0, 5.0) == LeaderState(2.0, 16.0, 0.0)
    assert slowed(LeaderState(0.0, 10.0, 6.0), 0.0, 5.0) == LeaderState(5.0, 40.0, 6.0)


def test_the_digits_of_a_coarse_sensor_show_its_resolution() -> None:
    assert [resolution(value) for value in (12.0, 12.5, 12.25, 12.4, 12.3, 12.35, 12.34)] == [
        1.0,
        0.5,
        0.25,
        0.2,
        0.1,
        0.05,
        0.02,
    ]
    assert resolution(12.3456789) == 0.0


def behind_ghost(ticks: int, speed_m_s: float, gap_m: float) -> tuple[list[Sample], Sample]:
    """Return a drive of 2 s with a ghost behind it, and the end of the drive.

    The ghost has a speed, and is once a second as far ahead of the own vehicle as before.
    """
    drive = driven(1.95, 0.1, cruising(40.0, 19.0), cruising(0.0, 25.0))
    ghosts = []
    for tick, n in product(range(ticks), range(10)):
        now_s = 2.0 + tick + 0.1 * n
        position_m = 25.0 * (2.0 + tick) + gap_m + speed_m_s * 0.1 * n
        ghosts.append(Sample(now_s, position_m, speed_m_s, 25.0 * now_s, 25.0))
    return drive + ghosts, drive[-1]


@pytest.mark.parametrize("ghost_m_s", [0.0, 5.0])
def test_what_moves_on_with_the_own_vehicle_is_a_ghost_and_hides_the_vehicle_seen_before(
    ghost_m_s: float,
) -> None:
    samples, last = behind_ghost(3, ghost_m_s, 12.0)
    track = track_of(samples)
    assert (track.status(samples[-1].time_s), track.seen) == (LeadStatus.FROZEN, last.lead)
    hidden_s = samples[-1].time_s - last.time_s - track.period_s
    lead = track.assumed_at(samples[-1].time_s, 9.0)
    assert lead is not None
    assert lead.speed_m_s == pytest.approx(19.0 - 3.0 * hidden_s), "it is not assumed to brake hard"
    later = track.assumed_at(last.time_s + track.period_s + 4.0, 9.0)
    assert later is not None
    assert later.speed_m_s == pytest.approx(19.0 - 3.0 * 3.0 - 9.0 * 1.0), "but it is after 3 s"


@pytest.mark.parametrize(("nearer_m", "counts_after"), [(0.0, 3), (-100.0, 13)])
def test_behind_a_ghost_the_hidden_vehicle_counts_at_once_and_another_one_later(
    nearer_m: float, counts_after: int
) -> None:
    samples, _ = behind_ghost(2, 0.0, 12.0)
    track = track_of(samples)
    for n in range(1, 14):
        now_s = samples[-1].time_s + 0.1 * n
        position_m, speed_m_s = cruising(40.0 - nearer_m, 19.0)(now_s)
        track = followed(track, Sample(now_s, position_m, speed_m_s, 25.0 * now_s, 25.0))
        assert track.frozen is (n < counts_after), n


def test_the_same_vehicle_in_a_wrong_place_is_no_ghost() -> None:
    samples, _ = behind_ghost(2, 19.0, 45.0)
    assert not track_of(samples[:-9]).ghost


def jumping(samples: list[Sample], from_s: float, until_s: float, by_m: float) -> list[Sample]:
    return [
        sample._replace(position_m=sample.position_m + by_m)
        if from_s <= sample.time_s < until_s
        else sample
        for sample in samples
    ]


@pytest.mark.parametrize(("by_m", "period_s"), [(3.0, 0.1), (5.0, 0.1), (12.0, 0.1), (5.0, 1.0)])
def test_a_gap_that_is_longer_at_once_counts_as_before_for_a_while(
    by_m: float, period_s: float
) -> None:
    samples = driven(40.0, period_s, cruising(40.0, 18.0), swaying)
    for sample_count in range(1, len(samples), 7):
        sound = samples[:sample_count]
        track = track_of(jumping(sound, 5.0, 15.0, by_m))
        newest = track.counted(jumping(sound, 5.0, 15.0, by_m)[-1].lead)
        assert newest.position_m == pytest.approx(sound[-1].position_m, abs=1e-6)
    stays = jumping(samples, 5.0, 100.0, by_m)
    assert not track_of(stays).is_doubtful, "another vehicle, after 20 s"


def test_another_vehicle_farther_on_at_another_speed_is_no_longer_gap() -> None:
    samples = driven(5.0, 0.1, cruising(40.0, 18.0), swaying)
    other = driven(10.0, 0.1, cruising(48.0, 15.0), swaying)[50:]
    track = track_of([*samples, *other])
    assert track.counted(other[-1].lead) == other[-1].lead


def test_a_speed_that_the_gap_contradicts_gives_way_to_it() -> None:
    """The vehicle brakes with 6 m/s^2 and is measured as driving on."""
    samples = driven(5.0, 0.1, cruising(40.0, 18.0), swaying)
    for step in range(1, 21):
        time_s, braked_s = samples[-1].time_s + 0.1, 0.1 * step
        at_m = 40.0 + 18.0 * time_s - 3.0 * braked_s * braked_s
        samples.append(Sample(time_s, at_m, 18.0 + 0.01 * step, *swaying(time_s)))
    track = track_of(samples)
    counted = track.counted(samples[-1].lead)
    assert counted.position_m == samples[-1].position_m
    assert counted.speed_m_s == pytest.approx(18.0 - 6.0 * 2.0, abs=1.5)


@pytest.mark.parametrize(("period_s", "wrong_m_s"), [(0.1, 33.0), (1.0, 8.0)])
def test_a_speed_that_is_far_off_at_every_step_is_not_another_vehicle_each_time(
    period_s: float, wrong_m_s: float
) -> None:
    """A vehicle creeps and is measured as driving, as with a relative speed of reversed sign."""
    creeping = cruising(120.0, 1.0)
    samples = driven(5.0 * period_s, period_s, creeping, swaying)
    for _ in range(5):
        time_s = samples[-1].time_s + period_s
        samples.append(Sample(time_s, creeping(time_s)[0], wrong_m_s, *swaying(time_s)))
    counted = track_of(samples).counted(samples[-1].lead)
    assert counted.speed_m_s <= 1.0 + 1e-6

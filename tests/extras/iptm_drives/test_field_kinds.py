"""Each kind of fault of the field, on each reader where it can occur.

What is drawn is read within the stated error and reported, or refused with a reason: never silent.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.extras.iptm_drives.field_drives import (
    LASTS_S,
    READERS,
    WITH_BOTH,
    WITH_HEIGHTS,
    WITH_PLACES,
    Driven,
    check,
    outcome,
    true_speed,
)

from iptm_core.errors import RouteError
from iptm_core.routes.user_trip import UserTrip

FEW = settings(
    max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 10.0])
def test_the_drive_itself_needs_no_repair(reader: str, rate_hz: float) -> None:
    found = outcome(reader, Driven.at(rate_hz))
    check(found, is_silent=True)
    assert isinstance(found, UserTrip)
    assert found.notes == ()


@pytest.mark.parametrize("reader", WITH_BOTH)
@pytest.mark.parametrize(
    ("factor", "note"),
    [
        (3.6, "is divided by 3.6 (km/h and m/s)"),
        (1.0 / 3.6, "(km/h and m/s)"),
        (1.943844, "(knots and m/s)"),
        (2.236936, "(mph and m/s)"),
        (1000.0, "(a thousandth and one)"),
        (1.852, "(knots and km/h)"),
        (1.609344, "(mph and km/h)"),
    ],
)
def test_k1_speeds_in_another_unit(reader: str, factor: float, note: str) -> None:
    drive = Driven.at()
    check(outcome(reader, drive.but(speeds=factor * drive.speeds)), note, may_refuse=False)


@pytest.mark.parametrize("reader", WITH_BOTH)
@FEW
@given(factor=st.sampled_from([0.1, 0.4, 0.6, 1.45, 2.6, 6.0]), shift=st.integers(0, 60))
def test_k1_sources_that_contradict(reader: str, factor: float, shift: int) -> None:
    drive = Driven.at()
    found = outcome(reader, drive.but(speeds=factor * np.roll(drive.speeds, shift)))
    assert isinstance(found, RouteError)
    assert "contradict" in str(found) or "by its speeds" in str(found) or "m/s^2" in str(found)


@pytest.mark.parametrize("reader", WITH_BOTH)
@pytest.mark.parametrize("value", [0.0, 3.0])
def test_k1_a_speed_that_is_not_measured(reader: str, value: float) -> None:
    drive = Driven.at(2.0)
    check(outcome(reader, drive.but(speeds=np.full(drive.speeds.size, value))), "throughout")


@pytest.mark.parametrize("reader", [name for name in READERS if name not in WITH_PLACES])
def test_k1_speeds_that_are_0_throughout_and_nothing_else(reader: str) -> None:
    found = outcome(reader, Driven.at().but(speeds=np.zeros(121)))
    assert isinstance(found, UserTrip)
    assert found.cycle.max_speed_m_s == 0.0
    assert "is 0 throughout" in "; ".join(found.notes)


@pytest.mark.parametrize("reader", WITH_BOTH)
@FEW
@given(begin=st.integers(12, 25), lasts=st.integers(4, 12))
def test_k1_speeds_that_drop_out(reader: str, begin: int, lasts: int) -> None:
    drive = Driven.at()
    out = (drive.times_s >= begin) & (drive.times_s < begin + lasts)
    found = outcome(reader, drive.but(speeds=np.where(out, 0.0, drive.speeds)))
    check(found, may_refuse=True, length_error=0.05)


@pytest.mark.parametrize("reader", WITH_BOTH)
def test_k1_a_place_that_jumps(reader: str) -> None:
    drive = Driven.at()
    moved = drive.along_m + np.where(drive.times_s > 30.0, 1500.0, 0.0)
    found = outcome(reader, drive.but(along_m=moved))
    assert not isinstance(found, RouteError), "its speeds are sound"
    assert any("the place leaps" in note for note in found.notes)
    assert found.cycle.distance_m == pytest.approx(drive.along_m[-1], rel=0.03)


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(at=st.integers(15, 110), back=st.floats(0.3, 300.0), rate=st.sampled_from([1.0, 10.0]))
def test_k2_a_clock_that_is_set_back(reader: str, at: int, back: float, rate: float) -> None:
    drive = Driven.at(rate)
    times = drive.times_s - np.where(drive.times_s > at, back, 0.0)
    if (np.diff(times) >= 0.0).all():
        return
    check(outcome(reader, drive.but(times_s=times)), length_error=0.03, may_refuse=True)


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(at=st.integers(15, 110), ahead=st.floats(20.0, 4e4))
def test_k2_a_clock_that_is_set_ahead(reader: str, at: int, ahead: float) -> None:
    drive = Driven.at(2.0)
    times = drive.times_s + np.where(drive.times_s > at, ahead, 0.0)
    found = outcome(reader, drive.but(times_s=times))
    # Without places nothing tells it from a gap, which is reported.
    has_places = reader in WITH_PLACES
    check(found, may_refuse=True, length_error=0.06 if has_places else 0.75)


@pytest.mark.parametrize("reader", READERS)
def test_k2_a_recording_that_begins_again(reader: str) -> None:
    drive = Driven.at()
    twice = drive.rows(np.concatenate([np.arange(121), np.arange(121)]))
    slower = np.repeat([1.0, 0.99], 121)
    found = outcome(reader, twice.but(received_s=np.arange(242.0), speeds=slower * twice.speeds))
    check(found, may_refuse=True)


ORDERS = {
    "newest first": np.arange(121)[::-1],
    "parts": np.r_[60:121, 0:60],
    "times as texts": np.array(sorted(range(121), key=str)),
    "shuffled": np.random.default_rng(5).permutation(121),
}


@pytest.mark.parametrize("reader", [name for name in READERS if name != "bag"])
def test_k2_the_same_drive_again_half_a_second_later(reader: str) -> None:
    drive = Driven.at()
    twice = drive.rows(np.r_[0:121, 0:121])
    found = outcome(reader, twice.but(times_s=np.r_[drive.times_s, 0.5 + drive.times_s]))
    assert isinstance(found, RouteError)
    assert "another recording begins" in str(found)


@pytest.mark.parametrize("reader", [name for name in READERS if name != "bag"])
@pytest.mark.parametrize("order", ORDERS)
def test_k2_rows_in_another_order(reader: str, order: str) -> None:
    check(outcome(reader, Driven.at().rows(ORDERS[order])), "not in the order of their times")


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(rows=st.lists(st.integers(2, 117), min_size=1, max_size=6, unique=True))
def test_k2_rows_that_repeat_or_are_late(reader: str, rows: list[int]) -> None:
    drive = Driven.at()
    order = np.sort(np.concatenate([np.arange(121), rows]))
    check(outcome(reader, drive.rows(order)))
    late = drive.times_s.copy()
    late[rows] -= 1.05
    check(outcome(reader, drive.but(times_s=late)), length_error=0.03)
    one_ahead = drive.times_s.copy()
    one_ahead[rows[0]] += 5000.0
    check(outcome(reader, drive.but(times_s=one_ahead)), length_error=0.03)


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(offset=st.floats(0.0, 0.4), apart=st.floats(30.0, 500.0), share=st.sampled_from([1, 3]))
def test_k2_two_senders(reader: str, offset: float, apart: float, share: int) -> None:
    one = Driven.at()
    two = one.rows(slice(None, None, share))
    two = two.but(
        times_s=two.times_s + offset,
        received_s=two.received_s + offset + 0.01,
        along_m=two.along_m - apart,
        speeds=0.4 * two.speeds,
    )
    both = {name: np.concatenate([vars(one)[name], vars(two)[name]]) for name in vars(one)}
    mixed = Driven(**both).rows(np.argsort(both["received_s"], kind="stable"))
    found = outcome(reader, mixed)
    assert isinstance(found, RouteError)
    assert "two senders" in str(found), str(found)


@pytest.mark.parametrize("reader", [name for name in READERS if name != "bag"])
@FEW
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.01, 0.15))
def test_k3_values_that_are_missing(reader: str, seed: int, share: float) -> None:
    drive, source = Driven.at(), np.random.default_rng(seed)

    def lost() -> np.ndarray:
        gone = source.random(121) < share
        gone[source.integers(121)] = True
        return gone

    changed = {"speeds": np.where(lost(), np.nan, drive.speeds)}
    if reader in WITH_HEIGHTS:
        changed["heights_m"] = np.where(lost(), np.nan, drive.heights_m)
    if reader in WITH_PLACES:
        changed["along_m"] = np.where(lost(), np.nan, drive.along_m)
    check(outcome(reader, drive.but(**changed)), length_error=0.04)
    if reader != "can":
        timeless = drive.but(times_s=np.where(lost(), np.nan, drive.times_s))
        check(outcome(reader, timeless), "without a time", length_error=0.04)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("mark", [-1.0, -9999.0, 655.35])
def test_k3_marks_of_invalid_speeds(reader: str, mark: float) -> None:
    if reader == "gpx" or (reader == "can" and mark < 0.0):
        return
    drive = Driven.at()
    marked = (drive.times_s < 3.0) | ((drive.times_s > 30.0) & (drive.times_s < 33.0))
    check(outcome(reader, drive.but(speeds=np.where(marked, mark, drive.speeds))), may_refuse=False)


@pytest.mark.parametrize("reader", WITH_PLACES)
@FEW
@given(pause_s=st.floats(10.0, 4000.0))
def test_k4_a_pause_of_the_device(reader: str, pause_s: float) -> None:
    """The device stops while the car stands; all that have places stand as long as it was, up to a minute."""
    drive = Driven.at()
    kept = (drive.times_s <= 52.0) | (drive.times_s >= 68.0)
    later = np.where(drive.times_s > 60.0, pause_s, 0.0)
    paused = drive.but(times_s=drive.times_s + later, received_s=drive.received_s + later)
    found = outcome(reader, paused.rows(kept))
    check(found, "1 pause")
    assert isinstance(found, UserTrip)
    expected_s = LASTS_S - 16.0 + min(16.0 + pause_s, 60.0)
    assert found.cycle.duration_s == pytest.approx(expected_s, abs=3.0)
    standing = found.cycle.speeds_m_s[54:64]
    assert standing.max() < 0.01


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(
    rate=st.sampled_from([1.0, 5.0, 20.0, 50.0, 100.0]),
    noise=st.floats(0.0, 0.12),
    whole_kmh=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_k5_noise_and_steps_at_any_rate(
    reader: str, rate: float, noise: float, whole_kmh: bool, seed: int
) -> None:
    drive, source = Driven.at(rate), np.random.default_rng(seed)
    speeds = drive.speeds + noise * source.standard_normal(drive.speeds.size)
    if whole_kmh:
        speeds = np.round(3.6 * speeds) / 3.6
    if reader == "can":
        speeds = np.maximum(speeds, 0.0)
    check(outcome(reader, drive.but(speeds=speeds)), is_silent=True)


@pytest.mark.parametrize("reader", READERS)
@FEW
@given(
    at=st.integers(12, 118),
    lasts=st.integers(1, 3),
    by=st.floats(20.0, 50.0),
    rate=st.sampled_from([1.0, 10.0]),
)
def test_k5_speeds_that_leap_and_come_back(
    reader: str, at: int, lasts: int, by: float, rate: float
) -> None:
    if reader == "gpx":
        return
    drive = Driven.at(rate)
    rows = np.arange(drive.times_s.size)
    odd = (rows >= at * rate) & (rows < at * rate + lasts)
    check(outcome(reader, drive.but(speeds=drive.speeds + np.where(odd, by, 0.0))), "not plausible")


@pytest.mark.parametrize("reader", WITH_PLACES)
@FEW
@given(at=st.integers(0, 118), lasts=st.integers(1, 3), by=st.floats(60.0, 3000.0))
def test_k5_places_aside(reader: str, at: int, lasts: int, by: float) -> None:
    drive = Driven.at()
    odd = (drive.times_s >= at) & (drive.times_s < at + lasts)
    found = outcome(reader, drive.but(east_m=np.where(odd, by, 0.0)))
    check(found, "aside", length_error=0.03)


@pytest.mark.parametrize("reader", WITH_PLACES)
@FEW
@given(at=st.integers(12, 32), lasts=st.integers(3, 8))
def test_k5_places_that_freeze(reader: str, at: int, lasts: int) -> None:
    drive = Driven.at()
    frozen = (drive.times_s > at) & (drive.times_s < at + lasts)
    along = np.where(frozen, np.interp(at, drive.times_s, drive.along_m), drive.along_m)
    check(outcome(reader, drive.but(along_m=along)), length_error=0.03)


@pytest.mark.parametrize("reader", WITH_HEIGHTS)
@pytest.mark.parametrize("height_m", [-32768.0, 0.0, 9999.0])
@FEW
@given(at=st.integers(0, 118), lasts=st.integers(1, 15))
def test_k5_heights_that_leap(reader: str, height_m: float, at: int, lasts: int) -> None:
    drive = Driven.at()
    odd = (drive.times_s >= at) & (drive.times_s < at + lasts)
    check(
        outcome(reader, drive.but(heights_m=np.where(odd, height_m, drive.heights_m))),
        "not plausible",
    )


@pytest.mark.parametrize("reader", WITH_HEIGHTS)
def test_k5_places_on_the_zero_island(reader: str) -> None:
    if reader not in WITH_PLACES or reader in {"fcd", "bag"}:
        return
    drive = Driven.at()
    zero = drive.times_s < 4.0
    along = np.where(zero, -48.2 * 111_200.0 / np.sqrt(0.5), drive.along_m)
    east = np.where(zero, -11.5 * 111_320.0 * np.cos(np.radians(48.2)) - along * np.sqrt(0.5), 0.0)
    check(outcome(reader, drive.but(along_m=along, east_m=east)))


@pytest.mark.parametrize("reader", ["csv", "library", "fcd", "bag", "csv with places"])
@pytest.mark.parametrize(("by", "is_refused"), [(0.002, False), (1.0, False), (8.0, True)])
def test_a_car_that_reverses(reader: str, by: float, is_refused: bool) -> None:
    drive = Driven.at(2.0)
    back = np.clip((drive.times_s - 52.0) / 5.0, 0, 1) * np.clip((66.0 - drive.times_s) / 5.0, 0, 1)
    moved = -by * np.clip(back, 0.0, 1.0)
    speeds = np.where(drive.speeds > 0.0, drive.speeds, moved)
    along = drive.along_m + np.cumsum(np.where(drive.speeds > 0.0, 0.0, 0.5 * moved))
    found = outcome(reader, drive.but(speeds=speeds, along_m=along))
    assert isinstance(found, RouteError) == is_refused, str(found)
    if isinstance(found, RouteError):
        assert "reverses" in str(found)
    else:
        check(found, length_error=0.03)
        assert found.cycle.speeds_m_s[:45].max() == pytest.approx(true_speed(20.0))

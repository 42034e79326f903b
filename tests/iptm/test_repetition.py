"""A short trip is judged by repeating it: the saving of many repetitions driven in one piece."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iptm
from iptm.repetition import _End, _one, _settled, one_after_the_other, repeat, why_not
from iptm_core.metrics.repeated import (
    Repetition,
    closed_stretch,
    over_cycles,
    over_noise,
    over_open_cycles,
    without_drift,
)
from iptm_core.metrics.saved_share import Basis, Judgement, judged_share

EXAMPLE = Path(__file__).parents[2] / "bags" / "example_us06_120s"
TOLERANCE_POINTS = 0.5
LED_IN = 10
"""Repetitions of the explicit drive in which the pack settles."""


def repeated_in_one_piece(count: int, **settings: Any) -> tuple[float, float]:
    """Return energy per metre and ageing of a repetition on a level road, from a drive of many but the first.

    A thermostat cools in some repetitions and not in others: their line over the drift is read at no drift.
    """
    trip = iptm.Trip.of(**settings)
    times, speeds = _one(trip.route, 1.0)
    seconds = np.arange(times[-1] * count + 1.0)
    leader = np.interp(np.mod(seconds[:-1], times[-1]), times, speeds)
    drive = {name: value for name, value in settings.items() if name not in {"cycle", "duration_s"}}
    rows = iptm.simulate((seconds, np.append(leader, speeds[-1])), **drive).trajectory
    bounds = np.searchsorted(rows.time_s, times[-1] * np.arange(LED_IN, count))
    energy = np.concatenate(([0.0], np.cumsum(rows.battery_power_w[1:] * rows.intervals_s)))
    lost = rows.cell_1_capacity_loss + rows.cell_n_capacity_loss
    warmth = 0.5 * (rows.cell_1_temperature_k + rows.cell_n_temperature_k)
    j_m = np.diff(energy[bounds]) / np.diff(rows.position_m[bounds])
    drifts = np.diff(warmth[bounds])
    lines = np.column_stack([np.ones_like(drifts), drifts])
    at_rest = np.linalg.lstsq(lines, np.column_stack([j_m, np.diff(lost[bounds])]), rcond=None)[0]
    return float(at_rest[0, 0]), float(at_rest[0, 1])


@pytest.mark.parametrize(
    "settings",
    [
        {"cycle": "us06", "duration_s": 120.0},
        pytest.param({"cycle": "wltc_class3b", "duration_s": 600.0}, marks=pytest.mark.slow),
        pytest.param({"cycle": "us06", "duration_s": 300.0}, marks=pytest.mark.slow),
        pytest.param(
            {"cycle": "udds", "duration_s": 400.0, "vehicle": "chevrolet_bolt", "climate": 35.0},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_short_trip_saves_what_its_repetitions_save(settings: dict[str, Any]) -> None:
    run, other = (
        iptm.simulate(**settings, strategy=each) for each in ("aging_cost_to_go", "production")
    )
    saving = run.saving(other)
    assert saving.energy.judgement is saving.aging.judgement is Judgement.JUDGED
    assert saving.energy.basis is saving.aging.basis is Basis.REPEATED
    own, base = (
        repeated_in_one_piece(LED_IN + 20, **settings, strategy=each)
        for each in ("aging_cost_to_go", "production")
    )
    for share, mine, theirs in zip((saving.energy, saving.aging), own, base, strict=True):
        expected = 100.0 * (1.0 - mine / theirs)
        assert share.percent == pytest.approx(expected, abs=TOLERANCE_POINTS)
        assert 0.5 <= share.uncertainty_points < 1.0
        assert "repeated" in share.as_driven
    assert run.saving(other) == saving


def test_a_trip_below_a_minute_is_too_short_and_one_that_cannot_be_repeated_has_a_band() -> None:
    quick = {"cycle": "us06", "horizon": "3x1"}
    tiny = iptm.simulate(**quick, duration_s=40.0, strategy="production")
    assert tiny.saving(tiny).energy.judgement is Judgement.TOO_SHORT
    run, other = (
        iptm.simulate(**quick, duration_s=90.0, strategy=each)
        for each in ("reference", "production")
    )
    assert why_not(replace(run, trip=None)) == "its trip is not known"
    found = replace(run, trip=None).saving(other).energy
    assert found.basis is Basis.BETWEEN
    ends = found.equal_ends_percent, found.as_driven_percent
    assert found.percent == pytest.approx(sum(ends) / 2.0)
    assert found.uncertainty_points == pytest.approx(abs(ends[0] - ends[1]) / 2.0)
    same = other.saving(other)
    assert same.energy.percent == same.aging.percent == 0.0


def test_a_pack_that_neither_warms_nor_cools_is_read_off_a_line() -> None:
    """Energy grows by 10 J/m and ageing by 1e-8 with every kelvin that a repetition cools the pack by."""
    tiles = [
        Repetition(500.0 - 10.0 * drift, 1e-6 - 1e-8 * drift, {"nca": 2e-6}, (drift, drift))
        for drift in (-3.0, -1.0, -0.5)
    ]
    found = without_drift(tiles, 5)
    assert found.energy_per_distance_j_m == pytest.approx(500.0, rel=1e-4)
    assert found.capacity_loss == pytest.approx(1e-6, rel=1e-4)
    assert found.cell_losses["nca"] == pytest.approx(2e-6)
    assert found.repetitions == 5
    assert found.energy_error > 0.0


def test_repetitions_that_differ_by_noise_are_averaged() -> None:
    """Energies of 1, 2 and 3 J/m: a mean of 2 with a standard error of 1 / sqrt(3)."""
    tiles = [Repetition(joule, 1e-9, {"nca": joule}, (0.1, -0.1)) for joule in (1.0, 2.0, 3.0)]
    found = over_noise(tiles, 7)
    assert found.energy_per_distance_j_m == pytest.approx(2.0)
    assert found.cell_losses["nca"] == pytest.approx(2.0)
    assert found.energy_error == pytest.approx(0.5 / np.sqrt(3.0))
    assert (found.aging_error, found.repetitions) == (0.0, 7)


def test_where_the_control_switches_at_random_the_pack_settles_all_the_same() -> None:
    """Single repetitions differ by 2 % there, the mean of the settled ones by much less."""
    run = iptm.load(EXAMPLE)
    found = repeat(run)
    assert found is not None
    later = list(islice(one_after_the_other(run), 10, 14))
    settled_j_m = np.mean([each.energy_per_distance_j_m for each in later])
    assert found.energy_per_distance_j_m == pytest.approx(settled_j_m, rel=0.01)
    assert found.energy_error < 0.01
    assert run.saving(run).energy.percent == 0.0


def test_cycles_of_a_thermostat_are_averaged_where_they_close() -> None:
    """One repetition cools by 3 K, three warm by 1 K each: every fourth one costs more."""
    warm, cool = (
        Repetition(joule, joule * 1e-9, {}, (drift, drift))
        for joule, drift in ((400.0, 1.0), (600.0, -3.0))
    )
    tiles = [warm, cool, warm, warm, warm, cool, warm]
    first, last = closed_stretch(tiles)
    assert sum(each.drift_k for each in tiles[first:last]) == 0.0
    assert over_cycles(tiles, 7).energy_per_distance_j_m == pytest.approx(450.0)
    open_cycle = over_cycles([cool, warm], 2)
    assert open_cycle.energy_per_distance_j_m == pytest.approx(450.0)


def test_the_pack_is_charged_and_the_motion_goes_on_between_repetitions() -> None:
    run = iptm.simulate("us06", duration_s=120.0, strategy="production")
    found = repeat(run)
    assert found is not None
    assert found.repetitions >= 3
    assert repeat(replace(run, other=run)) is found, "repetitions are kept with the trajectory"
    times, speeds = _one(run.trip.route, 1.0)  # type: ignore[union-attr]
    assert speeds[0] == speeds[-1]
    assert np.abs(np.diff(speeds) / np.diff(times))[0] <= 1.0


def test_two_cells_that_settle_at_different_rates_are_read_where_both_rest() -> None:
    """Drifts of both cells fade by 0.5 and 0.8; energy is 300 J/m plus 10 and 20 for each kelvin of drift."""
    tiles = [
        Repetition(300.0 + 10.0 * first + 20.0 * second, 1e-6, {}, (first, second))
        for first, second in ((0.5**k, -(0.8**k)) for k in range(3))
    ]
    assert without_drift(tiles[:1], 1).energy_per_distance_j_m == 290.0
    assert without_drift(tiles, 3).energy_per_distance_j_m == pytest.approx(300.0, rel=5e-3)


def test_cycles_that_do_not_close_give_a_range() -> None:
    """Each cycle costs more than the one before; a mean that begins later is higher."""
    tiles = [
        Repetition(400.0 + 10.0 * count, 1e-6, {}, (drift, drift))
        for count, drift in enumerate((2.0, -1.0) * 4)
    ]
    plain, found = over_cycles(tiles, 8), over_open_cycles(tiles, 8)
    assert found.energy_per_distance_j_m == plain.energy_per_distance_j_m
    assert found.energy_error > 0.02 > plain.energy_error
    wide = judged_share(Judgement.JUDGED, 20.0, 22.0, (22.5, 6.4), is_unclear=True)
    assert wide.text == "16.1 to 28.9 % saved"
    assert wide.percent == 22.5
    narrow = judged_share(Judgement.JUDGED, 20.0, 22.0, (22.5, 0.6), is_unclear=True)
    assert narrow.text == "22.5 % saved"


class SlowPack:
    """Stands for a trip whose pack settles at 300 K, with a time constant of fifty repetitions."""

    def __init__(self) -> None:
        self.driven = 0

    def drive(self, end: _End) -> tuple[Repetition, _End]:
        self.driven += 1
        drift = (300.0 - end.mean_k) / 50.0
        done = Repetition(400.0, 1e-6 * (1.0 + 0.02 * (end.mean_k - 298.0)), {}, (drift, drift))
        return done, end.at(end.cells_k + drift)


@pytest.mark.parametrize("start_k", [298.0, 280.0, 303.0])
def test_a_pack_that_warms_for_hours_is_judged_where_it_settles(start_k: float) -> None:
    """Its figures change by 0.08 % from one repetition to the next, and by 4 % in all."""
    pack: Any = SlowPack()
    end = _End(30.0, 10.0, 0.0, 0.0, start_k, start_k, is_cooling=False, has_cooled=False)
    found, _ = _settled(pack, end, 320.0)
    assert found is not None
    assert found.capacity_loss == pytest.approx(1.04e-6, rel=2e-3)
    assert pack.driven <= 5

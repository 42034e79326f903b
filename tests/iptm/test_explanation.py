"""Why a run saves: the parts add up to the saving, and each is what a drive or the law gives by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import iptm
from iptm.explanation import AGING, CAUSES, COOLING, DISTANCE, ENERGY, MOTION, PREVIEW, SAVED
from iptm_core.metrics.saving_parts import Part

TRIP = {"cycle": "nycc", "duration_s": 50.0, "horizon": "15x1"}


@pytest.fixture(scope="module")
def runs() -> tuple[iptm.Run, iptm.Run]:
    return iptm.simulate(**TRIP), iptm.simulate(**TRIP, strategy="reference")


def test_the_parts_add_up_to_the_saving_with_equal_ends(runs: tuple[iptm.Run, iptm.Run]) -> None:
    run, other = runs
    found = run.explain(other)
    saving = run.saving(other)
    assert found.table.loc[AGING, SAVED].sum() == pytest.approx(saving.aging.stated_percent)
    assert found.table.loc[ENERGY, SAVED].sum() == pytest.approx(saving.energy.stated_percent)
    causes = found.table.drop(columns=SAVED).sum(axis="columns")
    np.testing.assert_allclose(causes, found.table[SAVED], atol=1e-9)
    np.testing.assert_allclose(found.table[SAVED], iptm.compare(other, run).parts.iloc[:, 0])
    assert found.sentence.startswith("energy: too short to judge (as driven")
    assert f"{found.table.loc[AGING, DISTANCE].sum():+.1f} distance" in found.sentence
    assert np.abs(found.table[PREVIEW]).max() == 0.0, "both have the same preview"


def test_a_run_against_itself_has_no_cause(runs: tuple[iptm.Run, iptm.Run]) -> None:
    assert np.abs(runs[0].explain(runs[0]).table[[*CAUSES]]).to_numpy().max() == 0.0


def test_one_difference_has_one_cause(runs: tuple[iptm.Run, iptm.Run]) -> None:
    """The same control without a preview differs by that alone, at most with another distance."""
    blind = iptm.simulate(**TRIP, preview_mode="none")
    table = runs[0].explain(blind).table
    assert np.abs(table[[MOTION, COOLING]]).to_numpy().max() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(table[PREVIEW]).max() > 0.0


def test_a_thermostat_in_its_place_is_the_cause_of_its_cooling(
    runs: tuple[iptm.Run, iptm.Run],
) -> None:
    """Against a car without a preview: motion, cooling and preview differ."""
    production = iptm.simulate(**TRIP, strategy="production")
    table = runs[0].explain(production).table
    assert np.abs(table.loc[ENERGY, COOLING]).max() > 0.0
    assert np.abs(table[PREVIEW]).max() > 0.0


def test_a_lost_preview_is_a_cause(runs: tuple[iptm.Run, iptm.Run]) -> None:
    """Another desired headway is another distance, not another vehicle."""
    blind = iptm.simulate(
        **TRIP, preview_mode="none", overrides={"gap.desired_time_headway_s": 1.7}
    )
    table = blind.explain(runs[1]).table
    assert np.abs(table[PREVIEW]).max() > 1e-9


def test_parts_by_hand(runs: tuple[iptm.Run, iptm.Run]) -> None:
    """Throughput from the charge alone; half the current at the same temperatures has no other part."""
    run, other = runs
    points = iptm.compare(other, run).parts.iloc[:, 0]
    moved = [np.abs(np.diff(each.trajectory.state_of_charge)).sum() for each in runs]
    by_hand = 100.0 * (1.0 - moved[0] / moved[1])
    assert points[AGING, str(Part.THROUGHPUT)] == pytest.approx(by_hand)
    rows = other.trajectory
    charge = rows.state_of_charge[0] + 0.5 * (rows.state_of_charge - rows.state_of_charge[0])
    half = replace(other, trajectory=replace(rows, state_of_charge=charge))
    points = iptm.compare(other, half).parts.iloc[:, 0]
    assert points[AGING, str(Part.THROUGHPUT)] == pytest.approx(50.0, abs=0.01)
    assert points[AGING, str(Part.TEMPERATURE)] == pytest.approx(0.0, abs=1e-6)
    assert points[AGING, str(Part.C_RATE)] > 0.0, "the law counts high rates more"
    cooling = [each.metrics.cooling_energy_j / each.metrics.distance_m for each in runs]
    used = other.metrics.battery_energy_j / other.metrics.distance_m
    points = iptm.compare(other, run).parts.iloc[:, 0]
    assert points[ENERGY, str(Part.COOLING)] == pytest.approx(
        100.0 * (cooling[1] - cooling[0]) / used
    )


def test_what_cannot_be_explained_is_refused(runs: tuple[iptm.Run, iptm.Run]) -> None:
    run, other = runs
    for own, against, message in (
        (run, None, "other is None"),
        (replace(run, trip=None), other, "the trip is not known"),
        (run, iptm.simulate(**{**TRIP, "duration_s": 30.0}), "51 and 31 rows"),
        (run, iptm.simulate(**TRIP, overrides={"body.mass_kg": 1600.0}), "the vehicles differ"),
    ):
        with pytest.raises(iptm.IptmError, match=message):
            own.explain(against)
    unknown = np.full(len(run.trajectory), np.nan)
    dark = replace(run, trajectory=replace(run.trajectory, state_of_charge=unknown))
    points = iptm.compare(other, dark).parts.iloc[:, 0]
    assert points[AGING].isna().all()
    assert points[ENERGY].notna().all()

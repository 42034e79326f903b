"""The last lines of a run: few, in the units people use, and honest about how the two cars ended."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from tests.iptm.runner.conftest import with_metrics

from iptm.driving import drive_in_memory
from iptm.run import Run
from iptm.runner.summary import AGING_SAVED, Summary, summarise
from iptm.trip import Trip
from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics import RunMetrics

TRIP = Trip.of("nycc", duration_s=60.0)


@pytest.fixture(scope="module")
def comparison() -> Run:
    return drive_in_memory(TRIP.against("reference"))


def summary_of(metrics: RunMetrics, comparison: Run, against: Run | None) -> Summary:
    return summarise(with_metrics(comparison, metrics), against)


def test_figures_by_hand(comparison: Run) -> None:
    base = comparison.metrics
    run = replace(
        base,
        distance_m=2000.0,
        battery_energy_j=1.8e6,
        cooling_energy_j=3.6e5,
        cell_1_degradation=2.0e-7,
        cell_n_degradation=3.0e-7,
    )
    found = summary_of(run, comparison, None)
    assert found.values["aging_ppm"] == pytest.approx(0.5)
    assert found.values["energy_kwh"] == pytest.approx(0.5)
    assert found.values["consumption_kwh_per_100_km"] == pytest.approx(25.0)
    lines = dict(found.lines)
    assert AGING_SAVED not in lines
    assert lines["capacity lost"].startswith("0.500 ppm, both cells: cyclic aging")
    assert "not calendar aging" in lines["capacity lost"]
    assert lines["energy"] == (
        "0.500 kWh from the battery, 0.100 kWh of it for cooling; 25.0 kWh/100 km"
    )


def test_cars_that_end_alike_are_compared_as_they_are(comparison: Run) -> None:
    base = comparison.metrics
    better = replace(
        base,
        cell_1_degradation=0.7 * base.cell_1_degradation,
        cell_n_degradation=0.7 * base.cell_n_degradation,
    )
    found = summary_of(better, comparison, comparison)
    assert found.values["aging_saved_percent"] == pytest.approx(30.0)
    lines = dict(found.lines)
    assert lines[AGING_SAVED] == "30.0 % saved against the reference strategy"
    assert "equal ends" not in lines
    other = with_metrics(replace(comparison, settings={"strategy": "aging"}), better)
    worse = summary_of(base, comparison, other)
    assert dict(worse.lines)[AGING_SAVED] == "42.9 % lost against the aging strategy"


def test_a_car_that_ends_warmer_and_faster_is_corrected(comparison: Run) -> None:
    """A warm pack hides heat that the other car has paid for; the motion is energy that is left."""
    base = comparison.metrics
    warmer = replace(base, final_temperature_k=base.final_temperature_k + 5.0)
    found = summary_of(warmer, comparison, comparison)
    assert found.values["aging_saved_percent"] == 0.0
    assert found.values["corrected_aging_saved_percent"] < -1.0
    assert found.values["corrected_consumption_saved_percent"] < -1.0
    assert "lost with equal ends" in dict(found.lines)[AGING_SAVED]

    # 1 kWh of motion at the end of 1 km is 100 kWh/100 km.
    still = replace(base, distance_m=1000.0, battery_energy_j=7.2e6)
    other = with_metrics(comparison, still)
    moving = replace(still, final_speed_m_s=20.0, final_kinetic_energy_j=3.6e6)
    still_j = still.final_kinetic_energy_j
    found = summary_of(moving, comparison, other)
    assert found.values["corrected_consumption_kwh_per_100_km"] == pytest.approx(100.0)
    expected = 100.0 * (1.0 - 3.6e6 / (7.2e6 - still_j))
    assert found.values["corrected_consumption_saved_percent"] == pytest.approx(expected)


def test_a_run_without_figures_has_a_summary_all_the_same(comparison: Run) -> None:
    unknown = replace(comparison.metrics, distance_m=0.0)
    silent = replace(comparison, decisions=DecisionSeries.from_records([], []))
    found = summary_of(unknown, silent, comparison)
    assert math.isnan(found.values["consumption_kwh_per_100_km"])
    assert dict(found.lines)["solver"] == "no decisions reported"
    assert "– kWh/100 km" in dict(found.lines)["energy"]

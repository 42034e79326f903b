"""The last lines of a run: few, in the units people use, and honest about how the two cars ended."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.iptm.runner.conftest import with_metrics

from iptm.driving import drive_in_memory
from iptm.run import Run
from iptm.runner.summary import Summary, summarise
from iptm.trip import Trip
from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saving import ENERGY_SAVED, SHORTEST_WHOLE_S
from iptm_core.state import CommandSource

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
    assert ENERGY_SAVED not in lines
    assert lines["capacity lost"].startswith("0.500 ppm, both cells: cyclic ageing")
    assert "not calendar ageing" in lines["capacity lost"]
    assert lines["energy used"] == (
        "0.500 kWh from the battery, 0.100 kWh of it for cooling; 25.0 kWh/100 km"
    )


def lasting(metrics: RunMetrics, **changes: Any) -> RunMetrics:
    """Return the figures of a trip that is long enough to be judged."""
    return replace(metrics, duration_s=SHORTEST_WHOLE_S, **changes)


def test_the_headline_is_the_saving_with_equal_ends(comparison: Run) -> None:
    base = lasting(comparison.metrics)
    against = with_metrics(comparison, base)
    better = replace(
        base,
        final_temperature_k=base.final_temperature_k + 0.05,
        cell_1_degradation=0.7 * base.cell_1_degradation,
        cell_n_degradation=0.7 * base.cell_n_degradation,
    )
    found = summary_of(better, comparison, against)
    saved = found.values["aging_saved_percent"]
    assert 25.0 < saved < found.values["aging_saved_as_driven_percent"] == pytest.approx(30.0)
    lines = dict(found.lines)
    assert lines["ageing, paper's law"] == f"{saved:.1f} % saved (as driven 30.0 % saved)"
    assert lines["compared"].startswith("with the reference strategy, with equal ends")
    assert next(iter(lines)) == ENERGY_SAVED
    assert found.judgement == "judged"


def test_a_short_trip_has_no_number_in_its_headline(comparison: Run) -> None:
    found = summary_of(replace(comparison.metrics, duration_s=50.0), comparison, comparison)
    assert math.isnan(found.values["aging_saved_percent"])
    lines = dict(found.lines)
    assert lines[ENERGY_SAVED].startswith("too short to judge (as driven")
    assert lines["ageing, 6 cells"] == found.judgement == "too short to judge"


def test_broken_limits_and_missing_decisions_are_named() -> None:
    run = drive_in_memory(TRIP)
    first_lost_s = run.decisions.time_s[40]
    rows = run.decisions.time_s < first_lost_s
    left = {name: column[rows] for name, column in run.decisions.to_arrays().items()}
    stopped = np.where(run.trajectory.time_s > first_lost_s, CommandSource.STOP, 0.0)
    lost = replace(
        run,
        decisions=DecisionSeries.from_arrays(left),
        trajectory=replace(run.trajectory, command_source=stopped),
    )
    lines = dict(summarise(lost, None).lines)
    assert lines["solver"].endswith(
        "40 decisions, 20 ticks on a fallback, 20 of them stopped for want of commands"
    )
    hot = replace(run.trajectory, cell_1_temperature_k=run.trajectory.cell_1_temperature_k + 30.0)
    broken = replace(run, trajectory=hot)
    assert dict(summarise(broken, None).lines)["limit broken"].startswith("temperature of cell 1")
    assert broken.broken_limits.loc["temperature of cell 1", "first_s"] == 0.0
    assert "no limit broken" in dict(summarise(run, None).lines)["margin"]


def test_a_run_without_figures_has_a_summary_all_the_same(comparison: Run) -> None:
    unknown = replace(comparison.metrics, distance_m=0.0)
    silent = replace(comparison, decisions=DecisionSeries.from_records([], []))
    found = summary_of(unknown, silent, comparison)
    assert math.isnan(found.values["consumption_kwh_per_100_km"])
    assert dict(found.lines)["solver"] == "no decisions reported"
    assert "– kWh/100 km" in dict(found.lines)["energy used"]

"""A whole trip as one optimal control problem."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from studies.currency.run import WHOLE, costs
from studies.whole_trip import drive_whole_trip

from iptm.driving import drive_in_memory, simulate
from iptm.run import Run
from iptm.trip import Trip
from iptm_core.errors import IptmError


def trip(duration_s: float, **overrides: float) -> Trip:
    keys = {name.replace("__", "."): value for name, value in overrides.items()}
    return Trip.of(
        "us06",
        slope="small",
        strategy="aging",
        horizon="3x1+5x5",
        duration_s=duration_s,
        overrides=keys,
    )


def test_a_whole_trip_is_better_than_the_closed_loop_that_it_starts_from() -> None:
    finished, record = drive_whole_trip(trip(40.0))
    assert record["settled"]
    assert record["solves"][-1]["status"] == "solved"
    assert len(finished.trajectory) == 41
    assert len(finished.decisions) == 0

    def lost(run: Run) -> float:
        end = run.trajectory
        return float(end.cell_1_capacity_loss[-1] + end.cell_n_capacity_loss[-1])

    assert lost(finished) < lost(drive_in_memory(trip(40.0)))


def test_costates_are_what_a_kelvin_costs_the_rest_of_the_trip() -> None:
    """By difference: the same trip with both cells a little warmer at its start costs that much more."""
    step_k = 0.5
    costs: list[float] = []
    sums = []
    for initial_k in (308.15, 308.15 + step_k):
        _, record = drive_whole_trip(trip(60.0, environment__initial_cell_temperature_k=initial_k))
        costs.append(record["solves"][-1]["objective"] or 0.0)
        assert record["costate_times_s"] == [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
        sums.append(np.add(record["cell_1_costates_1_k"], record["cell_n_costates_1_k"]))
    both = np.mean(sums, axis=0)
    assert both.min() >= 0.0
    assert both[-1] == pytest.approx(0.0, abs=1e-3), "nothing comes after the end"
    # In this minute a kelvin is not lost: the first ten seconds are a part of what it costs in all.
    slope_1_k = (costs[1] - costs[0]) / step_k
    assert 0.5 * slope_1_k < both[0] < slope_1_k


def test_a_kelvin_with_a_value_beyond_the_trip_is_cooled_away_up_to_its_end() -> None:
    ends_k = []
    for beyond in (False, True):
        longer = trip(60.0).changed(strategy="aging_cost_to_go", value_beyond_trip=beyond)
        ends_k.append(drive_whole_trip(longer)[0].trajectory.cell_n_temperature_k[-1])
    assert ends_k[1] < ends_k[0] - 0.1


def test_a_whole_trip_is_one_problem() -> None:
    trip = Trip.of("us06", horizon="15x1", strategy="aging", duration_s=20.0)
    (whole, _), loop = drive_whole_trip(trip), drive_in_memory(trip)
    assert whole.name.startswith("whole trip, us06")
    assert len(whole.decisions) == 0
    assert whole.metrics.degradation < 1.01 * loop.metrics.degradation
    with pytest.raises(IptmError, match="which optimises nothing"):
        drive_whole_trip(trip.changed(strategy="production"))


def test_in_one_currency_nothing_costs_less_than_the_optimum_of_the_whole_trip() -> None:
    call: dict[str, Any] = {"cycle": "us06", "duration_s": 60.0}
    call["overrides"] = {"gap.desired_time_headway_s": 1.7}
    priced = {**call, "strategy": "prices", "value_beyond_trip": True}
    runs = {
        ("production", False): simulate(**call, strategy="production"),
        ("prices", False): simulate(**priced, preview_mode="none"),
        ("prices", True): simulate(**priced),
        (WHOLE, True): drive_whole_trip(Trip.of(**priced))[0],
    }
    trips = pd.DataFrame(
        {
            "car": "any",
            "ambient_c": 35.0,
            "cycle": "us06",
            "role": role,
            "perfect": perfect,
            "run": run,
        }
        for (role, perfect), run in runs.items()
    )
    found = {(row["role"], row["preview"]): row for row in costs(trips)}
    eur, share = ([row[name] for row in found.values()] for name in ("eur", "share"))
    production, unseen, seen, whole = eur
    assert whole < seen < min(production, unseen)
    assert share[0] == 0.0
    assert 0.0 < share[1] < share[2] < 100.0 == share[3]

"""One run in one process: repeatable, whatever the process did before."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm.studies.run import Run, controller_options, perform_run
from iptm.studies.run_spec import RunKind, RunSpec
from iptm.studies.study import Case, planned_run

AssertSame = Callable[[Run, Run], None]


def test_earlier_runs_leave_no_trace(
    short_inputs: Case, short_run: Run, assert_same: AssertSame
) -> None:
    other = planned_run(replace(short_inputs.spec, cycle="nycc", slope="large"))
    perform_run(other)
    signs: list[None] = []
    assert_same(perform_run(short_inputs, lambda: signs.append(None)), short_run)
    assert len(signs) == short_inputs.ticks


def test_solvers_that_carry_multipliers_start_anew(assert_same: AssertSame) -> None:
    spec = RunSpec(
        cycle="us06",
        duration_s=8.0,
        horizon="3x1+5x5",
        solver="ipopt",
        max_iterations=30,
    )
    inputs = planned_run(spec)
    assert_same(perform_run(inputs), perform_run(inputs))


def test_the_specification_reaches_the_controller() -> None:
    spec = RunSpec(horizon="3x1+5x5", solver="ipopt", tolerance=1e-7, max_iterations=77, tick_s=0.5)
    options = controller_options(spec, 300.0)
    assert str(options.horizon) == "3x1+5x5"
    assert options.strategy is spec.strategy
    assert options.tick_s == 0.5
    assert options.solver.name == "ipopt"
    assert options.solver.max_iterations == 77
    assert options.solver.tolerance == 1e-7


def test_a_whole_trip(short_inputs: Case) -> None:
    spec = replace(short_inputs.spec, kind=RunKind.WHOLE_TRIP, duration_s=40.0)
    signs: list[None] = []
    finished = perform_run(planned_run(spec), lambda: signs.append(None))
    record = finished.whole_trip
    assert finished.decisions is None
    assert record is not None
    assert record["settled"]
    assert len(signs) == 40 + len(record["solves"])
    assert record["solves"][-1]["status"] == "solved"
    assert len(finished.trajectory) == 41
    assert finished.wall_time_s > sum(solve["time_s"] for solve in record["solves"])
    # The optimum of its cost, so not worse than the run it started from.
    start = perform_run(planned_run(replace(spec, kind=RunKind.CLOSED_LOOP)))

    def lost(run: Run) -> float:
        end = run.trajectory
        return float(end.cell_1_capacity_loss[-1] + end.cell_n_capacity_loss[-1])

    assert lost(finished) < lost(start)


def test_costates_are_what_a_kelvin_costs_the_rest_of_the_trip(short_inputs: Case) -> None:
    """By difference: the same trip with both cells a little warmer at its start costs that much more."""
    step_k = 0.5
    costs: list[float] = []
    sums = []
    for initial_k in (308.15, 308.15 + step_k):
        spec = replace(
            short_inputs.spec,
            kind=RunKind.WHOLE_TRIP,
            duration_s=60.0,
            overrides=(("environment.initial_cell_temperature_k", initial_k),),
        )
        record = perform_run(planned_run(spec)).whole_trip
        assert record is not None
        costs.append(record["solves"][-1]["objective"] or 0.0)
        assert record["costate_times_s"] == [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
        sums.append(np.add(record["cell_1_costates_1_k"], record["cell_n_costates_1_k"]))
    both = np.mean(sums, axis=0)
    assert both.min() >= 0.0
    assert both[-1] == pytest.approx(0.0, abs=1e-3), "nothing comes after the end"
    # In this minute a kelvin is not lost: the first ten seconds are a part of what it costs in all.
    slope_1_k = (costs[1] - costs[0]) / step_k
    assert 0.5 * slope_1_k < both[0] < slope_1_k

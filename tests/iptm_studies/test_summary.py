"""The figures of a run, against hand-made results."""

from dataclasses import replace

import numpy as np
import pytest
from iptm_studies.summary import RunSummary, summarise

from iptm_core.trajectory import Trajectory
from iptm_studies.run_inputs import RunInputs
from iptm_studies.single_run import FinishedRun


@pytest.fixture
def summary(made_run: FinishedRun, short_inputs: RunInputs) -> RunSummary:
    return summarise(made_run.trajectory, made_run.log, None, short_inputs.parameters)


def test_solver_record(summary: RunSummary) -> None:
    solver = summary.solver
    assert solver is not None
    assert solver.ticks == 5
    assert solver.by_status == {
        "solved": 2,
        "feasible": 1,
        "iteration_limit": 1,
        "deadline": 0,
        "numerical_error": 0,
        "no_problem": 1,
    }
    assert solver.by_rung == {"optimal": 3, "shifted_plan": 1, "safe_law": 1, "stop": 0}
    assert (solver.fallbacks, solver.unconverged, solver.limiter_ticks) == (2, 3, 2)
    assert solver.mean_iterations == pytest.approx(62.0)
    assert solver.max_iterations == 150
    assert solver.median_ms == pytest.approx(2.0)
    assert solver.max_ms == pytest.approx(4.0)
    assert solver.p99_ms == pytest.approx(3.96)
    assert solver.total_s == pytest.approx(0.010)
    assert (solver.gap_slack_m, solver.temperature_slack_k) == (0.5, 0.0)


def test_figures_of_the_trip(summary: RunSummary, made_run: FinishedRun) -> None:
    values = summary.values()
    assert values["cell_1_degradation"] == pytest.approx(1e5 * 5e-9)
    assert values["total_degradation"] == pytest.approx(1e5 * 15e-9)
    assert summary.total_degradation == pytest.approx(15e-9)
    power_w = made_run.trajectory.battery_power_w
    assert values["peak_power"] == pytest.approx(1e-3 * power_w.max())
    assert values["lowest_power"] == pytest.approx(1e-3 * power_w[1:].min())
    assert values["mean_power"] == pytest.approx(1e-3 * power_w[1:].mean())
    assert values["mean_cop"] is None
    assert values["gap_violations"] == 0.0
    assert values["fallbacks"] == 2.0


def test_rows_do_not_depend_on_the_run(summary: RunSummary) -> None:
    keys = [row.key for row in summary.rows()]
    assert len(set(keys)) == len(keys)
    assert [row.key for row in replace(summary, solver=None).rows()] == keys


def test_gap_violations_count_collisions_and_short_gaps(
    made_run: FinishedRun, short_inputs: RunInputs
) -> None:
    columns = made_run.trajectory.to_arrays()
    columns["leader_position_m"] = columns["leader_position_m"].copy()
    columns["leader_position_m"][2] = columns["position_m"][2] - 0.5
    columns["leader_position_m"][4] = columns["position_m"][4] + 1.0
    short = summarise(Trajectory.from_arrays(columns), None, None, short_inputs.parameters)
    assert short.gap_violations == 3  # one row breaks both limits
    assert short.metrics.hard_violations == 1


def test_a_log_without_any_plan(made_run: FinishedRun, short_inputs: RunInputs) -> None:
    assert made_run.log is not None
    log = replace(made_run.log, gap_slack_m=np.full(5, np.nan))
    summary = summarise(made_run.trajectory, log, None, short_inputs.parameters)
    assert summary.solver is not None
    assert summary.solver.gap_slack_m == 0.0

"""The two ways from messages to figures agree, and whatever is amiss with a run is said."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from iptm_bringup.live_run import LiveRun, live_run, run_differences

from iptm_bringup.evaluation import EvaluatedRun, evaluate
from iptm_bringup.preparation import PreparedScenario
from iptm_bringup.results import results_json, solver_statistics
from iptm_core.errors import BagError, MessageError
from iptm_core.metrics import compute_metrics, metric_rows
from iptm_core.trajectory import Trajectory
from iptm_interfaces.topics import Topic
from iptm_recording.run_information import RunInformation
from iptm_recording.trajectory_reader import read_solve_series, read_trajectory

Heard = dict[Topic, list[bytes]]
Write = Callable[..., Path]


def judge(prepared: PreparedScenario, heard: Heard, bag: Path | None) -> EvaluatedRun:
    return evaluate(prepared, live_run(heard), bag, RunInformation(), wall_time_s=0.5)


def test_what_was_heard_is_what_was_driven(heard: Heard, trajectory: Trajectory) -> None:
    run = live_run(heard)
    for name, column in trajectory.to_arrays().items():
        np.testing.assert_array_equal(run.trajectory.to_arrays()[name], column, err_msg=name)
    assert run.incomplete_ticks == 0


def test_order_of_arrival_does_not_matter(heard: Heard) -> None:
    mixed = {topic: messages[::-1] for topic, messages in heard.items()}
    one, other = live_run(heard), live_run(mixed)
    assert run_differences(one, other.trajectory, other.solves) == []


def test_bag_and_live_run_agree_to_the_last_bit(
    heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag")
    live = live_run(heard)
    assert run_differences(live, read_trajectory(bag), read_solve_series(bag)) == []


def test_a_difference_of_one_bit_is_found(heard: Heard, trajectory: Trajectory) -> None:
    live = live_run(heard)
    columns = {name: column.copy() for name, column in trajectory.to_arrays().items()}
    columns["battery_power_w"][5] = np.nextafter(columns["battery_power_w"][5], 1.0)
    (found,) = run_differences(live, Trajectory.from_arrays(columns), live.solves)
    assert found.startswith("battery_power_w: heard ")
    assert found.endswith("in row 5")
    shorter = {name: column[:-1] for name, column in columns.items()}
    differences = run_differences(live, Trajectory.from_arrays(shorter), live.solves)
    assert "time_s: heard 21 values, the bag holds 20" in differences


def test_lost_messages_are_counted(heard: Heard) -> None:
    del heard[Topic.PLANT_POWERS][4]
    del heard[Topic.LEADER][9]
    run = live_run(heard)
    assert run.incomplete_ticks == 2
    assert len(run.trajectory) == 19
    heard[Topic.LEADER].clear()
    with pytest.raises(MessageError, match="no tick completely"):
        live_run(heard)


def test_a_good_run_has_no_problems(
    prepared: PreparedScenario, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    evaluated = judge(prepared, heard, write_bag(tmp_path / "bag"))
    results = evaluated.results
    assert results.problems == ()
    assert results.live_equals_bag is True
    assert results.bag_messages is not None
    assert results.bag_messages["/controller/command"] == 21
    assert results.speed_up == pytest.approx(40.0)
    expected = compute_metrics(live_run(heard).trajectory, prepared.model.values)
    assert results.metrics == expected
    assert results.information["git_revision"]


def test_a_run_that_was_not_recorded_is_judged_by_what_was_heard(
    prepared: PreparedScenario, heard: Heard
) -> None:
    results = judge(prepared, heard, None).results
    assert results.problems == ()
    assert results.live_equals_bag is None
    assert results.bag_messages is None


@pytest.mark.parametrize(
    ("drop", "problem"),
    [
        ((Topic.SLOPE, 0), None),
        ((Topic.COMMAND, 3), None),
        ((Topic.LEADER_PREVIEW, 4), "the bag holds 20 messages of v2x/leader_preview, 21 are"),
        ((Topic.CLOCK, 4), "the bag holds 20 messages of /clock, 21 are needed"),
        ((Topic.PLANT_BATTERY, 4), "the bag holds 20 messages of plant/battery, 21 are needed"),
        ((Topic.PLANT_ODOMETRY, 0), "the run covers 1 s to 20 s of a trip of 20 s"),
        ((Topic.SOLVE, 20), "differ"),
    ],
)
def test_an_incomplete_bag_is_a_problem(
    prepared: PreparedScenario,
    heard: Heard,
    write_bag: Write,
    tmp_path: Path,
    drop: tuple[Topic, int],
    problem: str | None,
) -> None:
    """One message more or less of the slope, and the answer to the last state, do no harm."""
    problems = judge(prepared, heard, write_bag(tmp_path / "bag", drop)).results.problems
    assert (problem is None) == (problems == ())
    assert problem is None or any(problem in found for found in problems)


def test_a_bag_with_a_gap_cannot_be_judged(
    prepared: PreparedScenario, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", (Topic.PLANT_POWERS, 7))
    with pytest.raises(BagError, match="lacks plant/powers at 7 s"):
        judge(prepared, heard, bag)


def test_a_run_that_is_too_short_is_a_problem(prepared: PreparedScenario, heard: Heard) -> None:
    cut = {topic: messages[:-3] for topic, messages in heard.items()}
    (problem,) = judge(prepared, cut, None).results.problems
    assert problem == "the run covers 0 s to 17 s of a trip of 20 s"


def test_a_broken_hard_limit_is_a_problem(
    prepared: PreparedScenario, heard: Heard, trajectory: Trajectory
) -> None:
    live = live_run(heard)
    columns = {name: column.copy() for name, column in trajectory.to_arrays().items()}
    columns["leader_position_m"][6] = columns["position_m"][6] - 0.5
    crashed = dataclasses.replace(live, trajectory=Trajectory.from_arrays(columns))
    evaluated = evaluate(prepared, crashed, None, RunInformation(), 1.0)
    (problem,) = evaluated.results.problems
    assert problem == "hard limit broken in 1 rows: collision, worst by 0.5 m at 6 s"


def test_parameters_of_another_vehicle_are_noticed(
    prepared: PreparedScenario, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    model = prepared.model
    body = dataclasses.replace(model.values.body, mass_kg=2000.0)
    values = dataclasses.replace(model.values, body=body)
    other = dataclasses.replace(prepared, model=dataclasses.replace(model, values=values))
    problems = judge(other, heard, write_bag(tmp_path / "bag")).results.problems
    assert "the model parameters in the bag are not those of the scenario" in problems


def test_statistics_of_the_solver(heard: Heard) -> None:
    statistics = solver_statistics(live_run(heard).solves)
    assert statistics.decisions == 21
    assert statistics.by_status == {"solved": 21}
    assert statistics.by_rung == {"optimal": 20, "shifted_plan": 1}
    assert statistics.limited == 1
    assert statistics.without_preview == 1
    assert statistics.preview_age_s.largest == 0.0
    assert statistics.solve_time_ms.median == pytest.approx(3.0)
    assert statistics.solve_time_ms.largest == pytest.approx(4.0)
    assert statistics.iterations.largest == 30.0
    assert statistics.gap_slack_m == 0.0


def test_statistics_without_any_solve(heard: Heard) -> None:
    live = live_run(heard)
    values: dict[str, Any] = {name: column[:0] for name, column in live.solves.values.items()}
    nothing = dataclasses.replace(live.solves, time_s=live.solves.time_s[:0], values=values)
    statistics = solver_statistics(nothing)
    assert statistics.decisions == 0
    assert np.isnan(statistics.solve_time_ms.median)


def test_results_are_plain_json(
    prepared: PreparedScenario, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    results = judge(prepared, heard, write_bag(tmp_path / "bag")).results
    unknown = dataclasses.replace(results.solver, gap_slack_m=float("nan"))
    text = results_json(dataclasses.replace(results, solver=unknown))
    document = json.loads(text)
    assert document["good"] is True
    assert document["scenario"] == "short"
    assert [row["key"] for row in document["rows"]] == [
        row.key for row in metric_rows(results.metrics)
    ]
    assert document["metrics"]["energy"]["cooling_j"] == results.metrics.energy.cooling_j
    assert document["solver"]["gap_slack_m"] is None
    assert document["live_equals_bag"] is True
    assert str(tmp_path) not in text


def test_the_live_run_is_read_only(heard: Heard) -> None:
    run: LiveRun = live_run(heard)
    with pytest.raises(ValueError, match="read-only"):
        run.trajectory.speed_m_s[0] = 1.0

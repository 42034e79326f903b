"""Figures come from the bag or from the received messages, and problems of a run are reported."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from tests.iptm.runner.conftest import with_metrics

from iptm.run import Run
from iptm.runner.evaluation import evaluate, results_json
from iptm.runner.summary import headline
from iptm.trip import Trip
from iptm_core.decision_record import distribution
from iptm_core.errors import BagError, MessageError
from iptm_core.metrics.figures import FIGURES, figure_values
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.state import LeaderState
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import encode_leader, serialized
from iptm_ros.recording.run_information import RunInformation
from iptm_ros.topics import Topic

Heard = dict[Topic, list[bytes]]
Write = Callable[..., Path]
NONE = np.array([])


def judge(trip: Trip, heard: Heard, bag: Path | None) -> Run:
    return evaluate(trip, heard, bag, RunInformation(), wall_time_s=0.5)


def test_bag_and_messages_heard_give_the_same_run_to_the_last_bit(
    trip: Trip,
    heard: Heard,
    trajectory: Trajectory,
    write_bag: Write,
    tmp_path: Path,
) -> None:
    """Whatever the order of arrival behind the beginning of the trip."""
    mixed = {topic: [messages[0], *messages[:0:-1]] for topic, messages in heard.items()}
    for run in (
        judge(trip, mixed, None),
        judge(trip, heard, write_bag(tmp_path / "bag")),
    ):
        for name, column in trajectory.to_arrays().items():
            np.testing.assert_array_equal(getattr(run.trajectory, name), column, err_msg=name)
        assert run.decisions.iterations.tolist() == list(range(10, 31))


def test_of_several_messages_of_a_stamp_the_last_one_counts_with_and_without_a_bag(
    trip: Trip,
    heard: Heard,
    trajectory: Trajectory,
    write_bag: Write,
    tmp_path: Path,
) -> None:
    """Whatever their bytes are: here those of the earlier message are the greater or the smaller ones."""
    for other_m in (-3.0, 1e9):
        messages = heard[Topic.LEADER]
        other = LeaderState(7.0, other_m, 1.0)
        heard[Topic.LEADER] = [
            *messages[:7], serialized(encode_leader(other)), *messages[7:]
        ]  # fmt: skip
        bag = write_bag(tmp_path / f"bag {other_m}")
        for run in (judge(trip, heard, None), judge(trip, heard, bag)):
            np.testing.assert_array_equal(
                run.trajectory.leader_position_m, trajectory.leader_position_m
            )
        heard[Topic.LEADER] = messages


def test_missed_messages_are_counted(trip: Trip, heard: Heard) -> None:
    del heard[Topic.PLANT_STATE][4]
    del heard[Topic.LEADER][9]
    run = judge(trip, heard, None)
    assert run.problems == ("the runner missed messages of 1 ticks",)
    assert len(run.trajectory) == 20
    assert any("v2x/leader is missing at 1 ticks" in note for note in run.warnings)
    heard[Topic.PLANT_STATE].clear()
    with pytest.raises(MessageError, match="no message of plant/state"):
        judge(trip, heard, None)


def test_what_only_the_runner_missed_is_no_problem(
    trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag")
    del heard[Topic.PLANT_STATE][5]
    results = judge(trip, heard, bag)
    assert results.problems == ()
    assert any("missed 1 states" in note for note in results.warnings)


def without_coolant(data: bytes) -> bytes:
    """Leave a value out of a state."""
    message = deserialize_message(data, JointState)
    place = list(message.name).index("coolant_inlet_temperature_k")
    message.name = [*message.name[:place], *message.name[place + 1 :]]
    message.position = [*message.position[:place], *message.position[place + 1 :]]
    return serialized(message)


def test_figures_are_those_of_what_was_published_and_the_rest_is_named(
    trip: Trip, heard: Heard
) -> None:
    """As from a plant of the user's; before, one missing topic left no figure at all."""
    heard[Topic.LEADER].clear()
    heard[Topic.PLANT_STATE] = [without_coolant(data) for data in heard[Topic.PLANT_STATE]]
    results = judge(trip, heard, None)
    values = figure_values(results.metrics)
    assert values["battery_energy"] > 0.0
    assert values["cell_1_temperature_mean"] > 20.0
    absent = {"smallest_gap", "smallest_margin"}
    assert not absent & values.keys()
    assert not any("gap" in key for key in values if key != "gap_violations")
    assert [note.partition(" was not")[0] for note in results.warnings] == [
        "leader_position_m", "coolant_inlet_temperature_k",
    ]  # fmt: skip
    assert dict(headline(results).lines)["margin"] == "smallest gap –"


def test_a_tick_without_a_leader_is_counted_and_the_rest_has_figures(
    trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    results = judge(trip, heard, write_bag(tmp_path / "bag", (Topic.LEADER, 9)))
    assert any("v2x/leader is missing at 1 ticks" in note for note in results.warnings)
    assert results.problems == ("the bag holds 20 messages of v2x/leader, 21 are needed",)
    whole = judge(trip, heard, None)
    assert results.metrics.battery_energy_j == whole.metrics.battery_energy_j
    assert results.metrics.smallest_gap_m == whole.metrics.smallest_gap_m


def test_a_good_run_has_no_problems(
    trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    results = judge(trip, heard, write_bag(tmp_path / "bag"))
    assert results.problems == ()
    assert results.bag_messages is not None
    assert results.bag_messages["/controller/command"] == 21
    assert results.speed_up == pytest.approx(40.0)
    expected = compute_metrics(results.trajectory, trip.parameters, results.decisions)
    assert figure_values(results.metrics) == figure_values(expected)
    assert results.information.git_revision


def test_a_run_that_was_not_recorded_is_judged_by_what_was_heard(trip: Trip, heard: Heard) -> None:
    results = judge(trip, heard, None)
    assert results.problems == ()
    assert results.bag_messages is None


@pytest.mark.parametrize(
    ("drop", "problem"),
    [
        ((Topic.SLOPE, 0), None),
        ((Topic.COMMAND, 3), None),
        ((Topic.LEADER_PREVIEW, 4), "the bag holds 20 messages of v2x/leader_preview, 21 are"),
        ((Topic.CLOCK, 4), "the bag holds 20 messages of clock, 21 are needed"),
        ((Topic.PLANT_BATTERY, 4), "the bag holds 20 messages of plant/battery, 21 are"),
        ((Topic.PLANT_STATE, 0), "the run covers 1 s to 20 s of a trip of 20 s"),
        ((Topic.PLANT_STATE, 20), "the bag lacks 1 states that the runner received"),
        ((Topic.SOLVE, 20), None),
    ],
)
def test_an_incomplete_bag_is_a_problem(
    trip: Trip,
    heard: Heard,
    write_bag: Write,
    tmp_path: Path,
    drop: tuple[Topic, int],
    problem: str | None,
) -> None:
    """One message more or less of the slope, and the answer to the last state, do no harm."""
    problems = judge(trip, heard, write_bag(tmp_path / "bag", drop)).problems
    assert (problem is None) == (problems == ())
    assert problem is None or any(problem in found for found in problems)


def test_a_bag_with_a_gap_cannot_be_judged(
    trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", (Topic.PLANT_STATE, 7))
    with pytest.raises(BagError, match="lacks plant/state at 7 s"):
        judge(trip, heard, bag)


def test_a_run_that_is_too_short_is_a_problem(trip: Trip, heard: Heard) -> None:
    cut = {topic: messages[:-3] for topic, messages in heard.items()}
    (problem,) = judge(trip, cut, None).problems
    assert problem == "the run covers 0 s to 17 s of a trip of 20 s"


def test_a_broken_hard_limit_is_a_problem(trip: Trip, heard: Heard) -> None:
    crash = encode_leader(LeaderState(6.0, 0.05 * 36.0 - 0.5, 0.5))
    heard[Topic.LEADER][6] = serialized(crash)
    (problem,) = judge(trip, heard, None).problems
    assert problem == "collision (hard limit): 1 tick, first at 6 s, worst by 0.5 m at 6 s"


def test_a_leader_too_fast_to_follow_is_noted(trip: Trip, heard: Heard) -> None:
    heard[Topic.LEADER][6] = serialized(encode_leader(LeaderState(6.0, 99.0, 60.0)))
    notes = judge(trip, heard, None).warnings
    assert any(
        "the leader drives up to 60 m/s, the ego vehicle at most 37.5" in note for note in notes
    )


def test_parameters_of_another_vehicle_are_noticed(
    trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path
) -> None:
    other = trip.changed(overrides="body.mass_kg=2000")
    problems = judge(other, heard, write_bag(tmp_path / "bag")).problems
    assert "the model parameters in the bag differ from the trip's" in problems


def test_results_are_plain_json(trip: Trip, heard: Heard, write_bag: Write, tmp_path: Path) -> None:
    results = judge(trip, heard, write_bag(tmp_path / "bag"))
    decisions = results.metrics.decisions
    assert decisions is not None
    unknown = dataclasses.replace(
        results.metrics,
        decisions=dataclasses.replace(decisions, preview_age_s=distribution(NONE)),
    )
    text = results_json(with_metrics(results, unknown), trip)
    document = json.loads(text)
    assert document["good"] is True
    assert document["scenario"] == "short"
    values = figure_values(results.metrics)
    assert {row["key"]: row["value"] for row in document["rows"]} == {
        key: values.get(key) for key in FIGURES
    }
    assert document["metrics"]["cooling_energy_j"] == results.metrics.cooling_energy_j
    assert document["metrics"]["decisions"]["by_rung"]["shifted_plan"] == 1
    assert document["metrics"]["decisions"]["preview_age_s"]["median"] is None
    assert str(tmp_path) not in text

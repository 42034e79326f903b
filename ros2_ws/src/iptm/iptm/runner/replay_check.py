"""The command `replay --check`: does a node reproduce the answers recorded in a bag?

A fresh process of the node gets the recorded inputs tick by tick, each when it has answered the one before.
Its answers are recorded and compared with the bag, field by field.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from iptm.runner.composition import node_command, parameter_file_text
from iptm.runner.environment import environment_of_run, process_environment
from iptm.runner.replay_feed import answer_steps, copy_without_repeats
from iptm.runner.replay_inputs import FINAL_ANSWER, OUTPUTS, read_recorded
from iptm.runner.supervisor import Supervisor
from iptm_core.errors import ScenarioError
from iptm_ros.connections import full_name
from iptm_ros.discovery import reserve_domain
from iptm_ros.recording.compare_bags import (
    TopicComparison,
    compare_bags,
)
from iptm_ros.recording.field_differences import NumberTolerance
from iptm_ros.recording.recorded_topics import TopicSelection
from iptm_ros.topics import PLANT, TOPICS, Topic

TOLERANCE = NumberTolerance(absolute=1e-6, relative=1e-6)
"""Of numbers, in their units: another processor or compiler rounds otherwise, and a solver ends elsewhere
within its tolerance."""
FINE_TOLERANCES: Mapping[Topic, tuple[tuple[str, ...], NumberTolerance]] = {
    Topic.PLANT_STATE: (("*_capacity_loss",), NumberTolerance(relative=1e-9)),
    Topic.SOLVE: (("*_1_k", "*_1_s"), NumberTolerance(relative=1e-4)),
}
"""Of fields whose numbers are small: an absolute tolerance would hide every difference."""
IGNORED_FIELDS = (
    "solve_time_s",
    "solve_wall_time_s",
    "iterations",
    "objective",
    "header.frame_id",
    "child_frame_id",
)
"""Fields not compared: they depend on the machine, amplify rounding, or are frame names, which changed."""


def check_node(
    bag: Path,
    node: str,
    *,
    namespace: str | None = None,
    changes: Mapping[str, Any] | None = None,
    tolerance: NumberTolerance | None = None,
    on_tick: Callable[[int, int], None] = lambda done, all_steps: None,  # noqa: ARG005
) -> list[TopicComparison]:
    """Feed a node the inputs of a bag, and compare its answers.

    Args:
        bag: bag folder or file.
        node: one of `NODES`.
        namespace: of the vehicle; needed only if the bag holds several.
        changes: parameters of the node to change against the recorded ones.
        tolerance: of all numbers; None for `TOLERANCE` and `FINE_TOLERANCES`.
        on_tick: called with the number of completed ticks and the number of all ticks.

    Returns:
        The outcome for every topic that the node publishes.

    Raises:
        BagError: the bag cannot be read or repeated.
        ScenarioError: the node does not start with these parameters, or gives no answer.
    """
    recorded = read_recorded(bag, node, namespace)
    parameters = {**recorded.parameters, **(changes or {})}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        environment = environment_of_run(stack.enter_context(reserve_domain()), folder / "ros")
        stack.enter_context(process_environment(environment))
        supervisor = Supervisor(environment, lambda name: folder / f"{name}.log")
        stack.callback(supervisor.stop)
        file = folder / "parameters.yaml"
        file.write_text(parameter_file_text(node, parameters), encoding="utf-8")
        command = node_command(node, file, recorded.namespace)
        if Topic.CLOCK in recorded.names:  # which a bag of a namespace need not have there
            command += ["-r", f"{Topic.CLOCK.value}:={recorded.names[Topic.CLOCK]}"]
        supervisor.start(node, command)
        answers = folder / "answers"
        outputs = tuple(topic for topic in OUTPUTS[node] if topic in recorded.names)
        final_answer, alive = FINAL_ANSWER[node], _alive(supervisor)
        plant = full_name(recorded.namespace, PLANT) if node == PLANT else ""
        answer_steps(
            recorded.steps, outputs, final_answer, recorded.names, answers, alive, on_tick, plant
        )
        once = copy_without_repeats(bag, list(recorded.names.values()), folder / "recorded")
        return [
            outcome
            for topic in outputs
            for outcome in _compare(once, answers, topic, recorded.names[topic], tolerance)
        ]


def _compare(
    bag: Path, answers: Path, topic: Topic, name: str, tolerance: NumberTolerance | None
) -> list[TopicComparison]:
    """Compare one topic; its fields of small numbers apart from the others."""
    selection = TopicSelection(include=(name,))
    fine, fine_tolerance = FINE_TOLERANCES.get(topic, ((), TOLERANCE))
    usual = compare_bags(
        bag,
        answers,
        selection=selection,
        tolerance=tolerance or TOLERANCE,
        ignored_fields=(*IGNORED_FIELDS, *(() if tolerance else fine)),
    )
    if not fine or tolerance:
        return usual
    others = tuple(name for name in TOPICS[topic].fields if not _matches(name, fine))
    apart = compare_bags(
        bag,
        answers,
        selection=selection,
        tolerance=fine_tolerance,
        ignored_fields=(*IGNORED_FIELDS, *others),
    )
    return [*usual, *(replace(each, topic=f"{each.topic} ({', '.join(fine)})") for each in apart)]


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _alive(supervisor: Supervisor) -> Callable[[], None]:
    def check() -> None:
        for ending in supervisor.endings():
            if ending.code != 0:
                reason = ending.last_lines[-1] if ending.last_lines else "no reason given"
                raise ScenarioError(f"{ending.name} {ending.how}: {reason}")

    return check


def tolerances_text(tolerance: NumberTolerance | None) -> str:
    """Return the tolerances of a check in words; None for those that differ by topic."""
    if tolerance is not None:
        return _tolerance_text(tolerance)
    fine = (
        f"{', '.join(fields)} of {topic.value} {_tolerance_text(tolerance)}"
        for topic, (fields, tolerance) in FINE_TOLERANCES.items()
    )
    return "; ".join((_tolerance_text(TOLERANCE), *fine))


def _tolerance_text(tolerance: NumberTolerance) -> str:
    return f"{tolerance.absolute:g} + {tolerance.relative:g} of the value"

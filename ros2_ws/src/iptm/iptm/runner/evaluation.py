"""A finished run over ROS 2, from its bag if there is one, its problems, and the run to compare it with."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from enum import Enum
from pathlib import Path
from typing import Any

from iptm.run import Run, following_notes
from iptm.run_file import read_run
from iptm.runner.monitor import heard_by_stamp
from iptm.runner.summary import headline
from iptm.trip import Trip
from iptm.trip_files import trip_text
from iptm_core.metrics.figures import FIGURES
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.settings import LeaderSource
from iptm_core.trajectory import Trajectory
from iptm_ros.assembly import assemble_decisions, assemble_run, split_trips, unpublished
from iptm_ros.codecs import s_from_ns, stamp_ns_of
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.run_information import RunInformation, stored_losses
from iptm_ros.recording.trajectory_reader import leader_remark
from iptm_ros.topics import PLANT, TICK_TOPICS, TOPICS, Topic

Heard = Mapping[Topic, Sequence[bytes]]
"""Serialised messages by topic, in order of arrival."""

_OF_PLANT = (Topic.CLOCK, *(topic for topic in Topic if topic.name.startswith("PLANT_")))
_OF_BRIDGE = (Topic.LEADER, Topic.LEADER_SAMPLES, Topic.LEADER_PREVIEW)
_OF_CONTROLLER = (
    Topic.COMMAND,
    Topic.SOLVE,
)


def evaluate(
    trip: Trip,
    heard: Heard,
    bag: Path | None,
    information: RunInformation,
    wall_time_s: float,
    problems: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> Run:
    """Compute the results of a run.

    Args:
        trip: the requested trip.
        heard: serialised messages received by the runner, by topic.
        bag: of the run, None without one.
        information: revision and versions, used without a bag.
        wall_time_s: from the beginning of the trip to its last clock.
        problems: problems found so far.
        warnings: warnings of the nodes.

    Raises:
        BagError: the bag cannot be read.
        MessageError: there is neither a bag nor a complete tick among the received messages.
    """
    found, notes = list(problems), [*warnings, *trip.notes]
    trips = split_trips((stamp_ns_of(data), None) for data in heard[Topic.PLANT_STATE])
    if len(trips) > 1:
        notes.append(f"the trip was begun {len(trips)} times; the figures belong to the last one")
    parameters = trip.model.values
    namespace = trip.conditions.namespace or None
    counts: dict[str, int] | None = None
    if bag is None:
        assembled = assemble_run(heard_by_stamp(heard, TICK_TOPICS))
        trajectory = assembled.trajectory
        decisions = assemble_decisions(heard_by_stamp(heard, (Topic.SOLVE,))[Topic.SOLVE])
        if assembled.incomplete:
            found.append(f"the runner missed messages of {len(assembled.incomplete)} ticks")
    else:
        with BagReader(bag) as reader:
            recorded = read_run(reader, namespace)
            counts = {name: topic.message_count for name, topic in sorted(reader.topics.items())}
            information = reader.run_information()
        trajectory, decisions = recorded.trajectory, recorded.decisions
        parameters = recorded.parameters
        if parameters != trip.model.values:
            found.append("the model parameters in the bag differ from the trip's")
        found += _missing_messages(counts, len(trajectory), trip)
        lost, missed = _unequal_states(trips[-1], trajectory)
        if lost:
            # A plant of the user need not wait for the recorder.
            (notes if PLANT in trip.foreign else found).append(
                f"the bag lacks {lost} states that the runner received"
            )
        if missed:
            notes.append(f"the runner missed {missed} states; the bag holds them")
    losses = None if bag is None else stored_losses(information)
    notes += unpublished(trajectory, has_leader=trip.rules.leader_source is not LeaderSource.NONE)
    notes += [remark] if (remark := leader_remark(trajectory, losses)) else []
    notes += following_notes(trajectory, parameters)
    (notes if PLANT in trip.foreign else found).extend(_unfinished(trajectory, trip))
    run = Run(
        name=trip.title,
        settings=trip.settings,
        parameters=parameters,
        trajectory=trajectory,
        decisions=decisions,
        slope=trip.route.slope,
        trip=trip,
        wall_time_s=wall_time_s,
        bag_messages=counts,
        problems=tuple(found),
        warnings=tuple(notes),
        information=information,
    )
    return replace(run, problems=(*found, *_broken_limits(run.metrics)))


def _unequal_states(heard: Iterable[int], trajectory: Trajectory) -> tuple[int, int]:
    """Return how many states only the runner has, given by their stamps, and how many only the bag has."""
    heard_s = set(map(s_from_ns, heard))
    recorded_s = set(trajectory.time_s.tolist())
    return len(heard_s - recorded_s), len(recorded_s - heard_s)


def _missing_messages(counts: Mapping[str, int], ticks: int, trip: Trip) -> list[str]:
    """Return a sentence per topic for which the bag lacks the message of a tick."""
    # In real time the plant does not wait for answers, so only its own messages are certain.
    complete = (*_OF_PLANT, *_OF_BRIDGE) if trip.is_lock_step else _OF_PLANT
    expected = dict.fromkeys(complete, ticks)
    road = trip.rules
    if road.keeps_rules and road.leader_source is not LeaderSource.CYCLE:
        expected.pop(Topic.LEADER, None)  # published where a vehicle is ahead
    if trip.is_lock_step:
        # The last state ends the trip, whether it is answered or not.
        expected |= dict.fromkeys(_OF_CONTROLLER, ticks - 1)
    expected[Topic.SLOPE] = 1
    prefix = trip.full_namespace.rstrip("/")
    sentences = []
    for topic, least in expected.items():
        if TOPICS[topic].publisher in trip.foreign:
            continue  # it may publish less than the suite's
        name = TOPICS[topic].name
        count = counts.get(name if name.startswith("/") else f"{prefix}/{name}", 0)
        if count < least:
            sentences.append(f"the bag holds {count} messages of {name}, {least} are needed")
    return sentences


def _unfinished(trajectory: Trajectory, trip: Trip) -> list[str]:
    start_s, end_s = float(trajectory.time_s[0]), float(trajectory.time_s[-1])
    duration_s = trip.route.duration_s
    if start_s == 0.0 and end_s >= duration_s - 1e-9:
        return []
    return [f"the run covers {start_s:g} s to {end_s:g} s of a trip of {duration_s:g} s"]


def _broken_limits(metrics: RunMetrics) -> list[str]:
    return [check.text for check in metrics.broken_limits if check.hard]


def results_json(run: Run, trip: Trip) -> str:
    """Return a run as JSON text; unknown values (NaN) become null."""
    values, other, summary = run.figures, run.other, headline(run)
    information = run.information
    document = {
        "scenario": trip.name,
        "run": run.name,
        "summary": {
            "text": [f"{label}: {text}" for label, text in summary.lines],
            "judgement": summary.judgement,
            **summary.values,
        },
        "trip": trip_text(trip),
        "good": not run.problems,
        "problems": list(run.problems),
        "warnings": list(run.warnings),
        "rows": [
            {"key": key, "label": figure.label, "value": values.get(key), "unit": figure.unit}
            for key, figure in FIGURES.items()
        ],
        "compared_with": other and {"strategy": other.strategy, "figures": other.figures},
        "metrics": asdict(run.metrics),
        "wall_time_s": run.wall_time_s,
        "speed_up": run.speed_up,
        "bag_messages": run.bag_messages,
        "information": information
        and {
            "git_revision": information.git_revision,
            "started_at_utc": information.started_at_utc,
            **information.versions,
        },
    }
    return json.dumps(_plain(document), indent=2, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Return a value with non-finite numbers, which JSON cannot represent, replaced."""
    if isinstance(value, Mapping):
        return {_name(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _name(key: object) -> str:
    return key.name.lower() if isinstance(key, Enum) else str(key)


def save_comparison(path: Path, other: Run, heading: str) -> None:
    """Write the trajectory of a run as a Parquet file with the columns of an exported run.

    Raises:
        BagError: the file cannot be written.
    """
    # Loaded only now: it takes time that the nodes can use better.
    from iptm_ros.recording.trajectory_file import (  # noqa: PLC0415
        export_table,
        trajectory_columns,
        write_parquet,
    )

    texts = {"table": "trajectory", "strategy": other.strategy, "compared_with": heading}
    write_parquet(path, export_table(trajectory_columns(other.trajectory), texts))

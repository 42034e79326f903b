"""A short made-up run, in every form that the runner meets: rows, bytes as heard, and a bag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock

from iptm.run import Run
from iptm.runner.composition import node_parameters, run_information
from iptm.trip import Trip
from iptm_core.decision_record import DecisionRecord
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.state import Command
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import encode_command, encode_decision_record, serialized, time_from_s
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.run_information import collect_run_information
from iptm_ros.topics import TOPICS, Topic

TICKS = 20
AnyRun = TypeVar("AnyRun", bound=Run)
Heard = dict[Topic, list[bytes]]
TickMessages = Callable[[Trajectory, int], dict[Topic, Any]]


def with_metrics(run: AnyRun, metrics: RunMetrics) -> AnyRun:
    """Return a run whose metrics are not those of its trajectory."""
    changed = replace(run)
    vars(changed)["metrics"] = metrics
    return changed


@pytest.fixture
def trip() -> Trip:
    """Twenty seconds of city traffic over hills."""
    return Trip.of("sc03", name="short", slope="small", duration_s=float(TICKS)).checked()


@pytest.fixture
def heard(
    trajectory: Trajectory,
    tick_messages: TickMessages,
    decision_record: Callable[[int], DecisionRecord],
) -> Heard:
    """The run as the monitor keeps it."""
    found: Heard = {}
    for row in range(len(trajectory)):
        time_s = float(trajectory.time_s[row])
        messages = tick_messages(trajectory, row) | {
            Topic.CLOCK: Clock(clock=time_from_s(time_s)),
            Topic.SOLVE: encode_decision_record(round(1e9 * time_s), decision_record(row)),
            Topic.COMMAND: encode_command(round(1e9 * time_s), Command(0.1, 0.0)),
        }
        for topic, message in messages.items():
            found.setdefault(topic, []).append(serialized(message))
    return found


@pytest.fixture
def write_bag(heard: Heard, trip: Trip) -> Callable[..., Path]:
    """Write the bag of the run; `drop` leaves out a message by (topic, row)."""

    def write(folder: Path, drop: tuple[Topic, int] | None = None) -> Path:
        described = run_information(trip, node_parameters(trip))
        information = collect_run_information(
            scenario=described["scenario"], seed=3, parameters=described["parameters"]
        )
        with BagWriter(folder, custom_data=information.to_custom_data()) as writer:
            for topic in TOPICS:
                name = TOPICS[topic].name
                absolute = name if name.startswith("/") else f"/{name}"
                channel = writer.add_topic(absolute, TOPICS[topic].type_name)
                empty = serialized(TOPICS[topic].message_type())
                messages = heard.get(topic, [empty] * (TICKS + 1))
                for row, data in enumerate(messages):
                    if (topic, row) != drop:
                        writer.write(channel, data, row * 10**9)
        return folder

    return write


@pytest.fixture
def diagnostics() -> Callable[..., DiagnosticArray]:
    """Build a diagnostic message of one node."""
    from iptm_ros.diagnostics import Level, build_status  # noqa: PLC0415

    def build(name: str, reason: str, level: Level = Level.OK, **values: object) -> DiagnosticArray:
        return DiagnosticArray(status=[build_status(name, level, reason, values)])

    return build

"""The contents of a bag, the inputs of its run, and the results."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table
from rosbags.interfaces import QosDurability

from iptm.runner.tables import decisions_table
from iptm_core.decision_record import DecisionStatistics
from iptm_core.errors import BagError, IptmError
from iptm_core.metrics.figures import FIGURES, figure_values
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.recorded_topics import TopicRecord
from iptm_ros.recording.run_information import RunInformation, stored_losses


def topics_table(reader: BagReader) -> Table:
    """Return the topics of a bag: name, type, messages, rate in recorded time, QoS."""
    table = Table("topic", "type", title=f"{reader.path.name}: topics", title_justify="left")
    table.add_column("messages", justify="right")
    table.add_column("1/s", justify="right")
    table.add_column("offered QoS")
    duration_s = reader.duration_s
    for topic in sorted(reader.topics.values(), key=lambda record: record.name):
        rate = (
            f"{(topic.message_count - 1) / duration_s:.2f}" if _has_rate(topic, duration_s) else ""
        )
        count = str(topic.message_count)
        table.add_row(topic.name, topic.type_name, count, rate, _qos_text(topic))
    return table


def overview_table(reader: BagReader, information: RunInformation) -> Table:
    """Return the size of a bag and what its run depended on."""
    table = Table("", "", title=f"{reader.path.name}: run", title_justify="left", show_header=False)
    rows = {
        "messages": str(reader.message_count),
        "recorded time": f"{reader.start_ns * 1e-9:.3f} s to {reader.end_ns * 1e-9:.3f} s"
        f" ({reader.duration_s:.3f} s)",
        "scenario": information.scenario,
        "seed": "" if information.seed is None else str(information.seed),
        "git revision": information.git_revision,
        "started": information.started_at_utc,
        "versions": ", ".join(f"{name} {text}" for name, text in information.versions.items()),
        "parameters": _lines_text(information.parameters),
        **{name: _lines_text(text) for name, text in information.extra.items()},
    }
    for name, value in rows.items():
        if value:
            table.add_row(name, value)
    return table


def result_tables(reader: BagReader, namespace: str | None = None) -> list[Table]:
    """Return the figures of the recorded run, and of its decisions if they were recorded.

    Raises:
        BagError: the bag does not hold a complete run of the suite.
    """
    # Decoding to the suite's messages needs ROS, everything else here does not.
    from iptm_ros.assembly import unpublished  # noqa: PLC0415
    from iptm_ros.recording.trajectory_reader import (  # noqa: PLC0415
        changes_in_words,
        leader_remark,
        read_decisions,
        read_settings_changes,
        read_trajectory,
        trip_starts_ns,
    )

    information, path = reader.run_information(), reader.path
    parameters, is_stored = read_model_parameters(reader)
    trajectory = read_trajectory(reader, namespace)
    try:
        decisions = read_decisions(reader, namespace)
    except BagError:  # a controller that does not report them
        decisions = None
    trips = len(trip_starts_ns(reader, namespace))
    remark = leader_remark(trajectory, stored_losses(information))
    run = information.extra.get("run", "")
    notes = [] if is_stored else ["limits of the default parameter set: the bag names no other"]
    notes += [f"the last of {trips} trips"] if trips > 1 else []
    notes += unpublished(trajectory)
    notes += [remark] if remark else []
    notes += changes_in_words(read_settings_changes(reader, namespace))
    title = f"{path.name}: results" + (f" of {run}" if run else "")
    table = Table("figure", title=title, title_justify="left")
    table.add_column("value", justify="right")
    table.add_column("unit")
    metrics = compute_metrics(trajectory, parameters, decisions)
    table.caption = "; ".join([*notes, *(check.text for check in metrics.broken_limits)]) or None
    for key, value in figure_values(metrics).items():
        figure = FIGURES[key]
        table.add_row(figure.label, figure.precise_text(value), figure.unit)
    if decisions is None:
        return [table]
    statistics = DecisionStatistics.of(decisions, trajectory)
    title = f"{path.name}: {statistics.decisions} decisions"
    return [table, decisions_table(title, statistics)]


def print_information(
    path: Path, console: Console, *, namespace: str | None = None, show_parameters: bool = False
) -> None:
    """Print everything about a bag."""
    with BagReader(path) as reader:
        information = reader.run_information()
        console.print(overview_table(reader, information))
        console.print(topics_table(reader))
        reader.verify()  # the tables above rely on the bag's own metadata
        try:
            for table in result_tables(reader, namespace):
                console.print(table)
        except (IptmError, ImportError) as error:  # the tables above need no ROS, this one does
            console.print(f"no figures of the run: {error}", style="dim", highlight=False)
    if show_parameters:
        console.print(information.parameters or "no parameters stored", highlight=False)


def _has_rate(topic: TopicRecord, duration_s: float) -> bool:
    return topic.message_count > 1 and duration_s > 0.0


def _qos_text(topic: TopicRecord) -> str:
    texts = [
        f"{qos.reliability.name}, {qos.history.name} {qos.depth}".lower().replace("_", " ")
        + (", transient-local" if qos.durability is QosDurability.TRANSIENT_LOCAL else "")
        for qos in topic.offered_qos
    ]
    return "; ".join(dict.fromkeys(texts))


def _lines_text(text: str) -> str:
    lines = text.strip().splitlines()
    return text.strip() if len(lines) <= 1 else f"{len(lines)} lines"

"""The command ``bag_info``: what is in a bag, what its run depended on and what it achieved."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import BagError, IptmError
from iptm_core.metrics import FIGURES, compute_metrics, figure_values
from iptm_recording.bag_reader import BagReader
from iptm_recording.metadata import TopicRecord
from iptm_recording.run_information import RunInformation

_PIPE_WIDTH = 140


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


def metrics_table(path: Path, namespace: str | None = None) -> Table:
    """Return the figures of the recorded run and of its decisions.

    Raises:
        BagError: the bag does not hold a complete run of the suite.
    """
    from iptm_recording.run_parameters import read_model_parameters  # noqa: PLC0415
    from iptm_recording.trajectory_reader import read_decisions, read_trajectory  # noqa: PLC0415

    parameters, is_stored = read_model_parameters(path)
    decisions = read_decisions(path, namespace)
    values = figure_values(compute_metrics(read_trajectory(path, namespace), parameters, decisions))
    caption = None if is_stored else "limits of the default parameter set: the bag names no other"
    table = Table("figure", title=f"{path.name}: results", title_justify="left", caption=caption)
    table.add_column("value", justify="right")
    table.add_column("unit")
    for key, value in values.items():
        figure = FIGURES[key]
        table.add_row(figure.label, figure.precise_text(value), figure.unit)
    return table


def print_information(
    path: Path, console: Console, *, namespace: str | None = None, show_parameters: bool = False
) -> None:
    """Print everything about a bag.

    Args:
        path: bag folder or .mcap file.
        console: where to print.
        namespace: namespace of the vehicle whose figures are wanted, if the bag holds several.
        show_parameters: print the parameters in full.

    Raises:
        BagError: the bag cannot be read.
    """
    with BagReader(path) as reader:
        information = reader.run_information()
        console.print(overview_table(reader, information))
        console.print(topics_table(reader))
    try:
        console.print(metrics_table(path, namespace))
    except (IptmError, ImportError) as error:  # the tables above need no ROS, this one does
        console.print(f"no figures of the run: {error}", style="dim", highlight=False)
    if show_parameters:
        console.print(information.parameters or "no parameters stored", highlight=False)


def _has_rate(topic: TopicRecord, duration_s: float) -> bool:
    return topic.message_count > 1 and duration_s > 0.0


def _qos_text(topic: TopicRecord) -> str:
    texts = [
        f"{qos.reliability.replace('_', ' ')}, {qos.history.replace('_', ' ')} {qos.depth}"
        + (", transient-local" if qos.durability == "transient_local" else "")
        for qos in topic.offered_qos
    ]
    return "; ".join(dict.fromkeys(texts))


def _lines_text(text: str) -> str:
    lines = text.strip().splitlines()
    return text.strip() if len(lines) <= 1 else f"{len(lines)} lines"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what is in a bag.

    Returns:
        0 on success, 2 when the bag cannot be read.
    """
    parser = argparse.ArgumentParser(
        prog="bag_info",
        description="Show the topics of a bag, what its run depended on and what it achieved.",
    )
    parser.add_argument("bag", type=Path, nargs="+", help="bag folder or .mcap file")
    parser.add_argument(
        "--namespace", help="vehicle whose figures are wanted, if there are several"
    )
    parser.add_argument("--parameters", action="store_true", help="print the stored parameters")
    options = parser.parse_args(arguments)
    console = Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)
    try:
        for path in options.bag:
            print_information(
                path, console, namespace=options.namespace, show_parameters=options.parameters
            )
    except BagError as error:
        print(f"bag_info: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

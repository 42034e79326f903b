"""The command `record`: its arguments, and the life of the recorder process."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from rclpy.utilities import remove_ros_args

from iptm_core.errors import BagError
from iptm_interfaces.process import run_node
from iptm_recording.bag_writer import COMPRESSIONS
from iptm_recording.recorded_topics import TopicSelection
from iptm_recording.recorder_node import DEFAULT_DEPTH, RecorderNode, RecorderOptions
from iptm_recording.run_information import collect_run_information, load_run_information
from iptm_recording.timeline import CLOCK_TOPIC, TimeSource


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line without its ROS arguments."""
    parser = argparse.ArgumentParser(
        prog="record",
        description="Record a run as a rosbag2 bag (MCAP). Ends on Ctrl-C; a kill loses almost nothing:"
        " see recover_bag. ROS arguments (namespace, remaps) follow after --ros-args.",
    )
    parser.add_argument(
        "output",
        type=Path,
        nargs="?",
        help="bag folder to create (default: bags/run_<date>_<time>); never overwritten",
    )
    parser.add_argument(
        "--all", action="store_true", help="every topic of the graph, as it appears"
    )
    parser.add_argument(
        "--topics",
        nargs="+",
        default=[],
        metavar="TOPIC",
        help="topics of the graph by name or pattern, such as '/plant/*'"
        " (default: the topic table of the suite, in the recorder's namespace)",
    )
    parser.add_argument(
        "--exclude", nargs="+", default=[], metavar="TOPIC", help="names or patterns to leave out"
    )
    parser.add_argument(
        "--time",
        choices=[source.value for source in TimeSource],
        default=TimeSource.SIMULATED.value,
        help="time that orders the bag: sim = from /clock (default), wall = of the computer",
    )
    parser.add_argument(
        "--run-information",
        type=Path,
        metavar="YAML",
        help="file with scenario, seed, parameters and further texts to store in the bag",
    )
    parser.add_argument(
        "--compression",
        choices=list(COMPRESSIONS),
        default="none",
        help="of the file (default: none; with compression a kill loses up to 64 KiB of messages)",
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=DEFAULT_DEPTH,
        help="messages queued per topic (default: %(default)s)",
    )
    return parser


def options_from(arguments: argparse.Namespace) -> RecorderOptions:
    """Turn parsed arguments into options.

    Raises:
        BagError: the file with the run information is missing or malformed, or the clock is excluded.
    """
    now = datetime.now().astimezone()
    root = Path(os.environ.get("IPTM_ROOT", "."))
    information = (
        load_run_information(arguments.run_information)
        if arguments.run_information is not None
        else collect_run_information()
    )
    source = TimeSource(arguments.time)
    return RecorderOptions(
        output=arguments.output or root / "bags" / f"run_{now:%Y%m%d_%H%M%S}",
        selection=_selection(arguments, source),
        discover=arguments.all or bool(arguments.topics),
        time_source=source,
        run_information=information,
        compression=arguments.compression,
        depth=max(1, arguments.depth),
    )


def _selection(arguments: argparse.Namespace, source: TimeSource) -> TopicSelection:
    """Return the topics wanted; always with the clock where the times come from it."""
    include = tuple(arguments.topics)
    if source is TimeSource.SIMULATED:
        include = (*include, CLOCK_TOPIC) if include else include
    selection = TopicSelection(include, tuple(arguments.exclude))
    if source is TimeSource.SIMULATED and not selection.takes(CLOCK_TOPIC):
        raise BagError(
            f"{CLOCK_TOPIC} is excluded, but the times of the bag come from it;"
            " use --time wall to record without it"
        )
    return selection


def main(arguments: Sequence[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM.

    Returns:
        0 after a clean end, 2 after a mistake of the user or a full disk.
    """
    command = list(sys.argv if arguments is None else arguments)
    parsed = build_parser().parse_args(remove_ros_args(command)[1:])
    return run_node(lambda: RecorderNode(options_from(parsed)), ["record", *command[1:]])


if __name__ == "__main__":
    sys.exit(main())

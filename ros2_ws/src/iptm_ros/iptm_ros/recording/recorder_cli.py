"""The command `record`: its arguments, and the life of the recorder process."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from iptm_core.errors import ParameterError
from iptm_core.program import refused, sections
from iptm_core.user_input import whole_number
from iptm_ros.command_line import own_arguments

# ruff: noqa: PLC0415  help needs no node
if TYPE_CHECKING:
    from iptm_ros.recording.recorder_node import RecorderOptions

PROGRAM = "iptm record"
COMPRESSIONS = ("none", "lz4", "zstd")
TIMES = ("sim", "wall")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line without its ROS arguments."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Record a run as a rosbag2 bag (MCAP). Ends on Ctrl-C; a kill loses almost nothing:"
        " see iptm recover. The services ~/pause, ~/resume and ~/split_bagfile (std_srvs/srv/Trigger)"
        " control it. ROS arguments (namespace, remaps) follow after --ros-args.",
    )
    parser.add_argument(
        "output",
        type=Path,
        nargs="?",
        help="bag folder to create (default: bags/run_<date>_<time>); never overwritten",
    )
    parser.add_argument(
        "--in-existing-folder",
        action="store_true",
        help="the folder exists and holds no bag yet, as that of a run with its logs",
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
        "--also",
        nargs=2,
        action="append",
        default=[],
        metavar=("TOPIC", "TYPE"),
        help="a further topic, as one of an extra, subscribed to at once; may be repeated",
    )
    parser.add_argument(
        "--exclude", nargs="+", default=[], metavar="TOPIC", help="names or patterns to leave out"
    )
    parser.add_argument(
        "--time",
        choices=TIMES,
        default=TIMES[0],
        help="time that orders the bag: sim = of the clock in the same namespace (default), wall = of "
        "reception",
    )
    parser.add_argument(
        "--run-information",
        type=Path,
        metavar="YAML",
        help="file with scenario, seed, parameters and further texts to store in the bag",
    )
    parser.add_argument(
        "--repeat",
        action="store_true",
        help="write the topics that repeat parts of plant/state and controller/command from these: of nodes "
        "of the suite, the same bytes, and less to do for all",
    )
    parser.add_argument(
        "--compression",
        choices=COMPRESSIONS,
        default="none",
        help="of the chunks, one per tick (default: none)",
    )
    parser.add_argument(
        "-b",
        "--max-bag-size",
        type=whole_number,
        default=0,
        metavar="BYTES",
        help="size at which a file of the bag is completed and the next one begun (default: 0, none)",
    )
    parser.add_argument(
        "-d",
        "--max-bag-duration",
        type=whole_number,
        default=0,
        metavar="SECONDS",
        help="time in the bag after which a file is completed and the next one begun (default: 0, none)",
    )
    parser.add_argument(
        "--start-paused", action="store_true", help="record nothing but latched topics at first"
    )
    parser.add_argument(
        "--qos-profile-overrides-path",
        type=Path,
        metavar="YAML",
        help="policies by topic to ask for, in place of the strictest that all publishers offer",
    )
    parser.add_argument(
        "--depth",
        type=whole_number,
        help="messages queued per topic (default: as many as the node allows)",
    )
    return parser


def options_from(arguments: argparse.Namespace) -> RecorderOptions:
    """Turn parsed arguments into options."""
    from iptm_ros.recording.mcap_file import FileLimits
    from iptm_ros.recording.recorded_topics import TopicSelection, load_qos_overrides
    from iptm_ros.recording.recorder_node import DEFAULT_DEPTH, RecorderOptions
    from iptm_ros.recording.run_information import collect_run_information, load_run_information
    from iptm_ros.recording.timeline import TimeSource

    now = datetime.now().astimezone()
    root = Path(os.environ.get("IPTM_ROOT", "."))
    information = (
        load_run_information(arguments.run_information)
        if arguments.run_information is not None
        else collect_run_information()
    )
    return RecorderOptions(
        output=arguments.output or root / "bags" / f"run_{now:%Y%m%d_%H%M%S}",
        selection=TopicSelection(tuple(arguments.topics), tuple(arguments.exclude)),
        discover=arguments.all or bool(arguments.topics),
        time_source=TimeSource(arguments.time),
        run_information=information,
        compression=arguments.compression,
        limits=FileLimits(arguments.max_bag_size, arguments.max_bag_duration),
        depth=DEFAULT_DEPTH if arguments.depth is None else max(1, arguments.depth),
        is_paused=arguments.start_paused,
        qos=load_qos_overrides(arguments.qos_profile_overrides_path),
        in_existing_folder=arguments.in_existing_folder,
        repeats=arguments.repeat,
        also=dict(arguments.also),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM; a section of arguments for each of several bags."""
    _, *given = sys.argv if arguments is None else arguments
    commands = [["record", *section] for section in sections(given)]
    try:
        parsed = [build_parser().parse_args(own_arguments(command)) for command in commands]
    except ParameterError as error:
        return refused(PROGRAM, error)
    from iptm_ros.process import run_nodes
    from iptm_ros.recording.recorder_node import RecorderNode

    def recorder(own: argparse.Namespace, command: list[str]) -> RecorderNode:
        return RecorderNode(options_from(own), cli_args=command, use_global_arguments=False)

    recorders = [[partial(recorder, *each)] for each in zip(parsed, commands, strict=True)]
    return run_nodes(recorders, commands[0])


if __name__ == "__main__":
    sys.exit(main())

"""The command `replay`: its arguments, and the life of the player process."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from iptm_core.errors import ParameterError
from iptm_core.user_input import number, whole_number
from iptm_interfaces.command_line import own_arguments
from iptm_interfaces.process import EXIT_USER_ERROR, run_node
from iptm_recording.playback import PlaybackOptions
from iptm_recording.player_node import PlayerNode
from iptm_recording.recorded_topics import TopicSelection

_DEFAULT_CLOCK_HZ = 40.0


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line without its ROS arguments."""
    parser = argparse.ArgumentParser(
        prog="replay",
        description="Play a bag onto the ROS 2 graph with its recorded timing."
        " ROS arguments (remaps) follow after --ros-args.",
    )
    parser.add_argument("bag", type=Path, help="bag folder or file")
    parser.add_argument(
        "--rate", type=number, default=1.0, help="times the recorded speed (default: 1)"
    )
    parser.add_argument(
        "--start", type=number, default=0.0, metavar="S", help="begin so many seconds into the bag"
    )
    parser.add_argument(
        "--duration", type=number, metavar="S", help="play so many recorded seconds (default: all)"
    )
    parser.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC", help="names or patterns to play"
    )
    parser.add_argument(
        "--exclude", nargs="+", default=[], metavar="TOPIC", help="names or patterns to leave out"
    )
    parser.add_argument(
        "--clock",
        type=number,
        nargs="?",
        const=_DEFAULT_CLOCK_HZ,
        metavar="HZ",
        help="publish /clock at this rate instead of the recorded one (without a number: 40 Hz)",
    )
    parser.add_argument(
        "--wait-for-subscribers",
        type=whole_number,
        default=0,
        metavar="N",
        help="begin when the played topics have N subscriptions together",
    )
    parser.add_argument(
        "--delay",
        type=number,
        default=1.0,
        metavar="S",
        help="time for subscribers to find the player before it begins (default: 1)",
    )
    return parser


def options_from(arguments: argparse.Namespace) -> PlaybackOptions:
    """Turn parsed arguments into options.

    Raises:
        BagError: a number is out of its range.
    """
    return PlaybackOptions(
        bag=arguments.bag,
        rate=arguments.rate,
        start_s=arguments.start,
        duration_s=arguments.duration,
        selection=TopicSelection(tuple(arguments.topics), tuple(arguments.exclude)),
        clock_hz=arguments.clock,
        wait_for_subscribers=arguments.wait_for_subscribers,
        delay_s=arguments.delay,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a bag once.

    Returns:
        0 at the end or when stopped, 2 after a mistake of the user.
    """
    command = list(sys.argv if arguments is None else arguments)
    try:
        parsed = build_parser().parse_args(own_arguments(command))
    except ParameterError as error:
        print(f"replay: {error}", file=sys.stderr)
        return EXIT_USER_ERROR
    return run_node(lambda: PlayerNode(options_from(parsed)), ["replay", *command[1:]])


if __name__ == "__main__":
    sys.exit(main())

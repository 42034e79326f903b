"""The command `replay`: its arguments, and the life of the player process."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from iptm_core.errors import ParameterError
from iptm_core.program import refused
from iptm_core.user_input import number, whole_number
from iptm_ros.command_line import own_arguments

# ruff: noqa: PLC0415  help needs no node
if TYPE_CHECKING:
    from iptm_bags.playback import PlaybackOptions

PROGRAM = "iptm replay"
_DEFAULT_CLOCK_HZ = 40.0
_ROS = "--ros-args"


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line without its ROS arguments."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Play a bag onto the ROS 2 graph with its recorded timing. While it plays, the services"
        " ~/pause, ~/resume, ~/toggle_paused and ~/play_next (std_srvs/srv/Trigger) and the parameters rate"
        " and seek_s of /player control it. ROS arguments (namespace, remaps) follow after --ros-args.",
    )
    parser.add_argument("bag", type=Path, help="bag folder or file")
    parser.add_argument(
        "-r", "--rate", type=number, default=1.0, help="times the recorded speed (default: 1)"
    )
    parser.add_argument(
        "--start",
        "--start-offset",
        type=number,
        default=0.0,
        metavar="S",
        help="start offset into the bag in seconds",
    )
    parser.add_argument(
        "--duration",
        "--playback-duration",
        type=number,
        metavar="S",
        help="recorded seconds to play (default: all)",
    )
    parser.add_argument("-l", "--loop", action="store_true", help="begin again at the end")
    parser.add_argument("-p", "--start-paused", action="store_true", help="begin paused")
    parser.add_argument(
        "-m",
        "--remap",
        type=_rule,
        nargs="+",
        default=[],
        metavar="OLD:=NEW",
        help="play a topic of the bag under another name",
    )
    parser.add_argument(
        "--qos-profile-overrides-path",
        type=Path,
        metavar="YAML",
        help="policies by topic of the bag, in place of those that its publishers offered",
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
        "-d",
        "--delay",
        type=number,
        default=1.0,
        metavar="S",
        help="time for subscribers to find the player before it begins (default: 1)",
    )
    return parser


def _rule(text: str) -> tuple[str, str]:
    """Read a rule in the form of `_without_rules`."""
    old, _, new = text.partition("=")
    if not (old and new):
        raise argparse.ArgumentTypeError(f"rule is {text!r}; allowed: OLD:=NEW")
    return (old if old.startswith("/") else f"/{old}"), new


def _without_rules(command: Sequence[str]) -> list[str]:
    """Return a command in which rules before the ROS arguments read `OLD=NEW`.

    ROS would take them for its own, in a way of writing them that it warns of.
    """
    end = command.index(_ROS) if _ROS in command else len(command)
    return [*(part.replace(":=", "=") for part in command[:end]), *command[end:]]


def options_from(arguments: argparse.Namespace) -> PlaybackOptions:
    """Turn parsed arguments into options."""
    from iptm_bags.playback import PlaybackOptions
    from iptm_ros.recording.recorded_topics import TopicSelection, load_qos_overrides

    return PlaybackOptions(
        bag=arguments.bag,
        rate=arguments.rate,
        start_s=arguments.start,
        duration_s=arguments.duration,
        selection=TopicSelection(tuple(arguments.topics), tuple(arguments.exclude)),
        clock_hz=arguments.clock,
        wait_for_subscribers=arguments.wait_for_subscribers,
        delay_s=arguments.delay,
        is_looping=arguments.loop,
        is_paused=arguments.start_paused,
        remap=dict(arguments.remap),
        qos=load_qos_overrides(arguments.qos_profile_overrides_path),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a bag."""
    command = _without_rules(sys.argv if arguments is None else arguments)
    try:
        parsed = build_parser().parse_args(own_arguments(command))
    except ParameterError as error:
        return refused(PROGRAM, error)
    from iptm_bags.player_node import PlayerNode
    from iptm_ros.process import run_node

    return run_node(lambda: PlayerNode(options_from(parsed)), ["replay", *command[1:]])


if __name__ == "__main__":
    sys.exit(main())

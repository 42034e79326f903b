"""The program `iptm`: one command for all that is done with trips, bags and nodes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

from iptm_core.program import EXIT_OK, EXIT_USER_ERROR, print_error
from iptm_core.user_input import suggestion

PROGRAM = "iptm"
EXACT = "--exact"
_EXACT_MODULE = "iptm_ros.recording.compare_bags"
COMMANDS_OF_NODES = {"send"}


@dataclass(frozen=True)
class Command:
    """A command: its module has `build_parser` and `main`, and is loaded only when it is asked for."""

    module: str
    summary: str


COMMANDS = {
    "run": Command("iptm.commands.run", "drive a trip, record it and report it"),
    "bench": Command("iptm_vehicle_interface.node_bench", "drive a car on a CAN bus in real time"),
    "meter": Command("iptm.meter", "energy, temperatures and ageing of a recorded or a live drive"),
    "traffic": Command("iptm_traffic.cli", "drive through simulated traffic (SUMO)"),
    "view": Command("iptm.runner.view", "show a run in the browser, live or from its bag"),
    "info": Command("iptm_ros.recording.bag_info", "list what a bag holds"),
    "compare": Command(
        "iptm.compare_cli", "compare runs, or two bags message by message (--exact)"
    ),
    "export": Command("iptm_ros.recording.export", "write a run as CSV or Parquet"),
    "record": Command("iptm_ros.recording.recorder_cli", "record topics into a bag"),
    "replay": Command("iptm_ros.recording.player_cli", "play a bag"),
    "recover": Command("iptm_ros.recording.recover", "save what is left of a damaged bag"),
    "check": Command("iptm.runner.replay_check", "compare a node with what it answered in a bag"),
    "drive": Command(
        "iptm.runner.recorded_drive", "show a recorded drive, or read one from a CAN log"
    ),
    "train": Command("iptm.predictor_training", "train the predictor of the leader"),
    "send": Command("iptm_v2x_bridge.node_sender", "send a drive as V2X messages"),
    "call": Command("iptm_ros.call", "call a service of a node"),
    "param": Command("iptm_ros.param", "read and set parameters of nodes"),
    "completion": Command("iptm.commands.completion", "print the tab completion for bash or zsh"),
}


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the program; commands parse what follows them."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description=__doc__,
        epilog=f"Options of a command: {PROGRAM} COMMAND --help.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and end")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.summary, add_help=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns:
        The exit code of the command; 2 for a command that does not exist.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in COMMANDS:
        name, *rest = given
        if name == "compare" and EXACT in rest:
            rest.remove(EXACT)
            name = f"{name} {EXACT}"
        sys.argv = [f"{PROGRAM} {name}", *rest]
        module = import_module(_EXACT_MODULE if name.endswith(EXACT) else COMMANDS[name].module)
        # A node takes its arguments from the command line.
        code: int | None = module.main() if COMMANDS_OF_NODES & {name} else module.main(rest)
        return code or EXIT_OK
    if given and not given[0].startswith("-"):
        print_error(PROGRAM, f"command {given[0]!r} is unknown; {suggestion(given[0], COMMANDS)}")
        return EXIT_USER_ERROR
    parsed = build_parser().parse_args(given)
    if parsed.version:
        from iptm import __version__  # noqa: PLC0415

        print(f"{PROGRAM} {__version__}")
        return EXIT_OK
    build_parser().print_help()
    return EXIT_OK

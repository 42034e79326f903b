"""The program `iptm`: one command for all that is done with trips, bags and nodes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

from iptm_core.extras import offered
from iptm_core.program import EXIT_OK, EXIT_USER_ERROR, print_error, refused
from iptm_core.user_input import suggestion

PROGRAM = "iptm"


@dataclass(frozen=True)
class Entry:
    """A command: a function, `module:name`, that reads the arguments of the process."""

    function: str
    summary: str

    def load(self) -> Callable[..., int | None]:
        """Return the function.

        Raises:
            ModuleNotFoundError: a library that it needs is not installed.
        """
        module, _, function = self.function.partition(":")
        loaded: Callable[..., int | None] = getattr(import_module(module), function)
        return loaded


COMMANDS = {
    "run": Entry("iptm.commands.run:main", "drive a trip, record it and report it"),
    "record": Entry("iptm_ros.recording.recorder_cli:main", "record topics into a bag"),
    "call": Entry("iptm_ros.call:main", "call a service of a node: pause, step, reset, save"),
    "param": Entry("iptm_ros.param:main", "read and set parameters of nodes"),
}


def all_commands() -> dict[str, Entry]:
    """Return the commands of the suite, then of extras.

    The module ``extra_commands`` of an extra has a mapping ``COMMANDS`` of names to function and summary.
    """
    found = dict(COMMANDS)
    for extra in offered("commands"):
        found |= {name: Entry(*row) for name, row in extra.COMMANDS.items()}
    return found


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
    for name, command in all_commands().items():
        commands.add_parser(name, help=command.summary, add_help=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns:
        The exit code of the command; 2 for a command that does not exist, or lacks what it needs.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    # Extras are looked for where the suite has no such command: that takes some milliseconds.
    known = COMMANDS if given and given[0] in COMMANDS else all_commands()
    if given and given[0] in known:
        return _run(known[given[0]], *given)
    if given and not given[0].startswith("-"):
        print_error(PROGRAM, f"command {given[0]!r} is unknown; {suggestion(given[0], known)}")
        return EXIT_USER_ERROR
    parsed = build_parser().parse_args(given)
    if parsed.version:
        from iptm import __version__  # noqa: PLC0415

        print(f"{PROGRAM} {__version__}")
        return EXIT_OK
    build_parser().print_help()
    return EXIT_OK


def _run(command: Entry, name: str, *rest: str) -> int:
    # Nodes take the arguments of ROS from the command line of the process.
    sys.argv = [f"{PROGRAM} {name}", *rest]
    try:
        code = command.load()()
    except ModuleNotFoundError as error:
        return refused(
            f"{PROGRAM} {name}",
            f"{error}; needed: ROS 2 and the extras of this command"
            f"{', or --over memory, which drives without ROS' if name == 'run' else ''}",
        )
    return code or EXIT_OK

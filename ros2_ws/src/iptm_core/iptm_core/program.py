"""How a program of the suite starts and ends: exit codes, and a mistake of the user in one line.

In a workspace that is built and run with a Python of its own, nothing installs what the packages import. Each
installed executable therefore starts with `main`, which looks it up by its name among the entry points of the
suite.
"""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from pathlib import Path

PROGRAMS = "iptm.programs"
"""Group of entry points in each ``setup.py``: name of an executable and its function."""
EXIT_OK = 0
EXIT_USER_ERROR = 2
EXIT_SIGNAL = 128
"""Added to the number of the signal that ended a program."""


def tell(program: str, what: object) -> None:
    """Say something in one line on stderr."""
    print(f"{program}: {' '.join(str(what).split())}", file=sys.stderr, flush=True)


def refused(program: str, reason: object) -> int:
    """Say what a user did wrong, as `tell` does; returns the exit code of the program."""
    tell(program, reason)
    return EXIT_USER_ERROR


def main() -> None:
    """Run the program that the executable is named after; exit with 2 if a library is not installed."""
    name = Path(sys.argv[0]).name
    try:
        (program,) = entry_points(group=PROGRAMS, name=name)
        function = program.load()
    except ModuleNotFoundError as error:
        install = "`python3 -m pip install -r requirements/run-no-ros.txt`"
        needed = f"ROS 2 and the workspace sourced, and {install}"
        sys.exit(refused(name, f"{error} for {sys.executable}; needed: {needed}"))
    sys.exit(function())

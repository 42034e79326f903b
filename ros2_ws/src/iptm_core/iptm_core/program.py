"""Installed executables: a library that is missing is one line, not a traceback.

In a workspace that is built and run with a Python of its own, nothing installs what the packages import. Each
executable therefore starts here and is looked up by its name among the entry points of the suite.
"""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from pathlib import Path

PROGRAMS = "iptm.programs"
"""Group of entry points in each ``setup.py``: name of an executable and its function."""
EXIT_USER_ERROR = 2


def main() -> None:
    """Run the program that the executable is named after; exit with 2 if a library is not installed."""
    name = Path(sys.argv[0]).name
    try:
        (program,) = entry_points(group=PROGRAMS, name=name)
        function = program.load()
    except ModuleNotFoundError as error:
        print(
            f"{name}: {error} for {sys.executable}; needed: ROS 2 and the workspace sourced, and "
            "`python3 -m pip install -r requirements/run-no-ros.txt`",
            file=sys.stderr,
        )
        sys.exit(EXIT_USER_ERROR)
    sys.exit(function())

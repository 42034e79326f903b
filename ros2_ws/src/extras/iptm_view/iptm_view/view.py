"""The command `view`: a run in the browser beside the car that it is compared with."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm_core.errors import IptmError
from iptm_core.program import refused
from iptm_ros.command_line import own_arguments
from iptm_view.options import PROGRAM, build_parser

REFERENCE_COMMAND = (sys.executable, "-m", "iptm_view.reference_drive")


def main(arguments: Sequence[str] | None = None) -> int:
    """Show a run in the browser; arguments are a command line with the name of the program."""
    command = list(sys.argv if arguments is None else arguments)
    try:
        parsed = build_parser().parse_args(own_arguments(command))
    except IptmError as error:
        return refused(PROGRAM, error)
    from iptm_view.showing import show  # noqa: PLC0415  help needs no view

    return show(parsed, command, REFERENCE_COMMAND)


if __name__ == "__main__":
    sys.exit(main())

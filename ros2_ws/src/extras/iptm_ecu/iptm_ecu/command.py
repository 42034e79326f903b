"""The command `codegen`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, refused
from iptm_core.user_input import number

PROGRAM = "iptm codegen"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write a controller as C99.

    Returns:
        0 on success, 2 when an argument is refused or a file cannot be written.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Write a controller as C99 into a folder: sources, a CMake file, and recorded ticks with"
        " a program that drives the controller through them and compares its commands.",
    )
    parser.add_argument("folder", type=Path, help="is made; files of the same names are replaced")
    parser.add_argument("--horizon", help="default: the controller's")
    parser.add_argument("--strategy", help="default: the controller's")
    parser.add_argument("--parameter-set", help="parameters of the model; default: the paper's")
    parser.add_argument("--cycle", default="wltc_class3b", help="of the recorded ticks")
    parser.add_argument(
        "--ticks", type=number, default=600.0, help="length of the record, default: %(default)g s"
    )
    given = parser.parse_args(arguments)
    # Not for --help: what it needs takes a moment to load.
    from iptm_ecu.codegen import write_controller  # noqa: PLC0415

    try:
        count = write_controller(
            given.folder,
            strategy=given.strategy,
            horizon=given.horizon,
            parameter_set=given.parameter_set,
            cycle=given.cycle,
            duration_s=given.ticks,
        )
    except IptmError as error:
        return refused(PROGRAM, error)
    except OSError as error:
        return refused(PROGRAM, f"{given.folder} cannot be written: {error}")
    print(f"{count} files in {given.folder}")
    return EXIT_OK

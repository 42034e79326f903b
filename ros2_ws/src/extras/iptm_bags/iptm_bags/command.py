"""The command `recover`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, EXIT_REFUSED, print_error

PROGRAM = "iptm recover"


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a sound bag of a damaged one.

    Returns:
        0 on success, 1 when nothing could be recovered.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Make a sound bag of one that was killed, cut short or damaged, and list the losses.",
    )
    parser.add_argument("source", type=Path, help="bag folder or .mcap file; it is not changed")
    parser.add_argument(
        "-o", "--output", type=Path, help="bag folder to create (default: <source>_recovered)"
    )
    given = parser.parse_args(arguments)
    # Not for --help: it takes a moment to load.
    from iptm_bags.recover import recover  # noqa: PLC0415

    try:
        report = recover(given.source, given.output)
    except IptmError as error:
        print_error(PROGRAM, error)
        return EXIT_REFUSED
    print(report)
    return EXIT_OK

"""The command behind ``scripts/study``: runs studies, and lists or confirms pages that may be out of date."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

PROGRAM = "study"
NAMES = tuple(sorted(path.parent.name for path in Path(__file__).parent.glob("*/README.md")))
ALL, STALE, CONFIRM = "all", "stale", "confirm"
EXIT_OK, EXIT_NOT_HELD = 0, 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0 when everything is as it should be, 1 when something did not hold, failed or is stale, 2 for a
        refusal.
    """
    parser = argparse.ArgumentParser(PROGRAM, description=__doc__)
    parser.add_argument("what", choices=[*NAMES, ALL, STALE, CONFIRM], help="study or command")
    parser.add_argument(
        "rest", nargs=argparse.REMAINDER, help="options, see scripts/study NAME --help"
    )
    chosen = parser.parse_args(arguments)
    from studies.running import answer  # noqa: PLC0415  a second of imports, not for --help

    return answer(chosen.what, chosen.rest)


if __name__ == "__main__":
    sys.exit(main())

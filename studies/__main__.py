"""The command behind ``scripts/study``: runs studies, and lists or confirms pages that may be out of date."""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from iptm_core.user_input import one_of

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
    known = [*NAMES, ALL, STALE, CONFIRM]
    parser.add_argument(
        "what", type=one_of(known), metavar="WHAT", help=f"one of {', '.join(known)}"
    )
    parser.add_argument(
        "rest", nargs=argparse.REMAINDER, help="options, see scripts/study NAME --help"
    )
    chosen = parser.parse_args(arguments)
    names = NAMES if chosen.what == ALL else (chosen.what,)
    options = {name: parser_of(name).parse_args(chosen.rest) for name in names}
    from studies.running import answer  # noqa: PLC0415  a second of imports, not for --help

    return answer(options)


def parser_of(name: str) -> argparse.ArgumentParser:
    """Return the parser of a study, which is not loaded for that, or of a command."""
    parser = argparse.ArgumentParser(f"{PROGRAM} {name}")
    add = parser.add_argument
    if name == STALE:
        parser.description = "Lists pages whose code or data have changed since."
        return parser
    if name == CONFIRM:
        parser.description = (
            "Runs the short forms; a page whose short form is the same still holds."
        )
        add("names", nargs="*", metavar="NAME", help="studies (all)")
        return parser
    folder = Path(__file__).parent / name
    parser.description = ast.get_docstring(ast.parse((folder / "run.py").read_text("utf-8")))
    add("--short", action="store_true", help="a little of everything, in seconds")
    add("--page", action="store_true", help=f"write the page in studies/{name} itself")
    add("--output", type=Path, metavar="DIR", help=f"folder of the page (results/{name})")
    add("--workers", type=int, metavar="N", help="processes (one per core)")
    add("--cluster", metavar="ADDRESS", help="scheduler of dask.distributed that computes instead")
    add("--cache", type=Path, metavar="DIR", help="folder of finished runs")
    add("--no-cache", action="store_true", help="keep no finished runs, and use none")
    add("--quiet", action="store_true", help="no progress")
    if (folder / "options.py").exists():
        import_module(f"studies.{name}.options").add_options(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())

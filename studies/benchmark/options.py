"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="held-out trips drawn by this seed in place of the tasks",
    )
    parser.add_argument(
        "--entrant",
        action="append",
        default=[],
        metavar="FILE",
        help="a further entrant, see docs/how-to/benchmark.md; repeatable",
    )

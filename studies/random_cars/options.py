"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse

from iptm_core.user_input import number, whole_number

RUNS, SEED, DURATION_S = 1000, 1, 200.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    for name, usual, text in (
        ("runs", RUNS, "number of runs"),
        ("seed", SEED, "seed of all draws"),
    ):
        text = f"{text}, {usual} by default"  # noqa: PLW2901
        parser.add_argument(f"--{name}", type=whole_number, default=usual, metavar="N", help=text)
    parser.add_argument(
        "--duration-s",
        type=number,
        metavar="T",
        default=DURATION_S,
        help=f"length of all trips, {DURATION_S:g} by default; 0 for those drawn",
    )

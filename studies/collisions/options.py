"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse

TRIALS, STRIDE = 6, 1
"""Trials of each family, headway, radio and seed; stride in the grids of UN R157."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    for name, text, usual in (
        ("trials", "trials of each family, headway, radio and seed", TRIALS),
        ("stride", "stride of distances and sideways speeds in the grids of UN R157", STRIDE),
    ):
        parser.add_argument(f"--{name}", type=int, metavar="N", help=f"{text}, {usual} by default")

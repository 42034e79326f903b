"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse

USUAL = {"trials": 400, "braking": 8000, "ros": 8, "seed": 1}
"""Numbers of trials, and the seed of all draws."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    for name, text in (
        ("trials", "disturbed trials"),
        ("braking", "trials with a braking lead vehicle"),
        ("ros", "of the disturbed trials that are driven over ROS 2 as well"),
        ("seed", "seed of all draws"),
    ):
        text = f"{text}, {USUAL[name]} by default"  # noqa: PLW2901
        parser.add_argument(f"--{name}", type=int, metavar="N", help=text)

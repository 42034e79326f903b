"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    add = parser.add_argument
    add("--duration-s", type=float, default=600.0, help="length of each trip, s (600)")
    add("--seed", type=int, default=1, help="of the traffic (1)")
    add(
        "--scenario",
        action="append",
        help="only this one, or the example of an own network; repeatable",
    )
    add("--know", action="append", help="only with this knowledge; repeatable")

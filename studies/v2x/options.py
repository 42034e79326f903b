"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse

PARTS = ("prediction", "price", "attacks", "load")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    parser.add_argument("--only", action="append", choices=PARTS, help="only this part; repeatable")
    parser.add_argument("--trip", action="append", help="trip of the price; repeatable")
    parser.add_argument("--leader", action="append", help="how the leader is predicted; repeatable")
    text = "pairs of accuracy and link, the most usual ones first (all)"
    parser.add_argument("--cells", type=int, help=text)
    parser.add_argument("--seed", type=int, default=1, help="of loss on the radio (1)")

"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse
from pathlib import Path

from iptm_core.settings import LoopMode


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    modes = ["headless", *map(str, LoopMode)]
    add = parser.add_argument
    add("--only", action="append", metavar="KIND", help="only this kind of fault; repeatable")
    add("--mode", action="append", choices=modes, help="only this mode; repeatable")
    add("--cycle", action="append", metavar="NAME", help="another cycle; repeatable")
    add("--catalogue", type=Path, metavar="FILE", help="of faults (default: the shipped one)")

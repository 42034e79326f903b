"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the option of this study."""
    parser.add_argument("--beyond", action="store_true", help="48 more trips, for beyond.md")

"""Options of the study, read before the study itself is loaded, which takes a second."""

from __future__ import annotations

import argparse


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    parser.add_argument(
        "--whole",
        action="store_true",
        help="all cycles, controls and refrigerants at all temperatures; without it WLTC with the "
        "thermostat, and the others at -10 and 35 degC",
    )

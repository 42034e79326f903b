"""The command `plan`: its arguments."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from iptm_plan import PROGRAM


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan.

    Returns:
        0 on success, 1 when a charge that is asked for is out of reach, 2 when the file is refused.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Plan when a parked car is charged, how far and at what power, and when its pack is "
        "cooled or heated from the plug; with the prices of a kelvin and of charge at departures and "
        "arrivals. Compared with rules of today.",
    )
    parser.add_argument("week", type=Path, help="YAML or JSON: departures, weather, tariff, car")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write the plan, with a charging profile"
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the plan (PNG or SVG)")
    given = parser.parse_args(arguments)
    # Numerical libraries are loaded once the arguments are known: help is answered without them.
    from iptm_plan.planning import plan_week  # noqa: PLC0415

    return plan_week(given.week, given.json, given.picture)

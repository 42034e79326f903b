"""The command `plan`: the plan of a file, beside the rules, as tables, JSON and a picture."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, EXIT_REFUSED, print_error, refused
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plan.course import Course
from iptm_plan.day_plan import DayPlan
from iptm_plan.picture import draw
from iptm_plan.profile import CLOCK, missed_charges, plan_data
from iptm_plan.rules import RULES, Rule
from iptm_plan.week_file import Week, read_week

PROGRAM = "iptm plan"
PIPE_WIDTH = 140


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
    try:
        week = read_week(given.week)
        plan = DayPlan(week.schedule, week.pack, week.price)
        course = plan.course(week.charge, week.kelvin)
        ruled = {
            name: plan.course(week.charge, week.kelvin, Rule(week.schedule, week.pack, **rule))
            for name, rule in RULES.items()
        }
    except IptmError as error:
        return refused(PROGRAM, error)
    try:
        if given.json is not None:
            text = json.dumps(plan_data(week, plan, course), indent=1)
            given.json.write_text(text + "\n", encoding="utf-8")
        if given.picture is not None:
            draw(week, plan, course, next(iter(ruled.items())), given.picture)
    except (OSError, ValueError) as error:
        return refused(PROGRAM, f"cannot be written: {error}")
    _print(week, plan, course, ruled)
    missed = list(missed_charges(week, course))
    for line in missed:
        print_error(PROGRAM, line)
    return EXIT_REFUSED if missed else EXIT_OK


def _print(week: Week, plan: DayPlan, course: Course, ruled: Mapping[str, Course]) -> None:
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    doors = Table("", "at", title="departures and arrivals")
    for heading in ("charge, %", "pack, °C", "a kelvin more, EUR", "a per cent less, EUR"):
        doors.add_column(heading, justify="right")
    for each in plan.worth(course):
        name = "departure" if each.is_departure else "arrival"
        doors.add_row(
            f"{name} {each.stage + 1}",
            f"{week.local(each.step):{CLOCK}}",
            f"{100.0 * each.charge:.1f}",
            f"{each.kelvin - CELSIUS_ZERO_K:.1f}",
            f"{each.eur_per_k:+.4f}",
            f"{each.eur_per_percent:+.4f}",
        )
    console.print(doors)
    costs = Table("", title="costs")
    for heading in (
        "energy, kWh",
        "energy, EUR",
        "ageing, EUR",
        "in all, with what is left, EUR",
    ):
        costs.add_column(heading, justify="right")
    least = plan.cost_eur(course)
    for name, other in {"plan": course, **ruled}.items():
        costs.add_row(
            name,
            f"{other.grid_kwh:.2f}",
            f"{other.energy_eur:.3f}",
            f"{other.aging_eur:.3f}",
            f"{plan.cost_eur(other) - least:+.3f}",
        )
    console.print(costs)

"""The plan of a file, beside the rules, as tables, JSON and a picture."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, EXIT_REFUSED, print_error, refused
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plan import PROGRAM
from iptm_plan.course import Course
from iptm_plan.day_plan import DayPlan
from iptm_plan.picture import draw
from iptm_plan.profile import CLOCK, missed_charges, plan_data
from iptm_plan.rules import RULES, Rule
from iptm_plan.week_file import Week, read_week

PIPE_WIDTH = 140


def plan_week(path: Path, json_path: Path | None, picture_path: Path | None) -> int:
    """Plan the week of a file and print it.

    Args:
        json_path: where the plan with its charging profile is written.
        picture_path: where the plan is drawn.

    Returns:
        0 on success, 1 when a charge that is asked for is out of reach, 2 when the file is refused.
    """
    try:
        week = read_week(path)
        plan = DayPlan(week.schedule, week.pack, week.price)
        course = plan.course(week.charge, week.kelvin)
        ruled = {
            name: plan.course(week.charge, week.kelvin, Rule(week.schedule, week.pack, **rule))
            for name, rule in RULES.items()
        }
    except IptmError as error:
        return refused(PROGRAM, error)
    try:
        if json_path is not None:
            text = json.dumps(plan_data(week, plan, course), indent=1)
            json_path.write_text(text + "\n", encoding="utf-8")
        if picture_path is not None:
            draw(week, plan, course, next(iter(ruled.items())), picture_path)
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

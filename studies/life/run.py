"""The capacity that temperature control saves over years of use, and trips that end at a fast charger."""

from __future__ import annotations

from typing import Any

from studies.life.charging_page import charging_values
from studies.life.charging_stop import (
    FIRST_CAR,
    MINUTE_VALUES_AIR_C,
    SHORT,
    arrival,
    arrival_calls,
    evening,
    evening_calls,
    minute_calls,
)
from studies.life.decisions import decision_cases, decisions, routes_of
from studies.life.own_law import priced_cases
from studies.life.page import life_values
from studies.life.table import life_table
from studies.life.trips import roads, trip_cases, trip_maps
from studies.session import Session

from iptm_life.trip_map import START_C
from iptm_life.year import CITY, USAGES

CHARGING_PAGE = "charging-stop.md"
SHORT_START_C = (22.0, 36.0)
SHORT_S = 60.0


def run(session: Session) -> bool:
    """Run the study; returns whether every trip was driven."""
    short = session.short
    start_c = SHORT_START_C if short else START_C
    routes = {CITY: (CITY,)} if short else routes_of(session.scratch / "drives")
    usages = USAGES[:1] if short else USAGES
    of_years = [*trip_cases(start_c), *priced_cases(start_c)]
    single = decision_cases(routes)
    if short:
        of_years, single = (
            [case.shortened(SHORT_S) for case in part] for part in (of_years, single)
        )
    years, trips = session.drive(of_years), session.drive(single)
    if session.failures:
        return False
    session.say("years are composed ...")
    maps = trip_maps(years)
    decided = decisions(trips, routes, maps)
    session.render(**life_values(life_table(maps, usages), decided, roads(years)))
    return charging_stop(session)


def charging_stop(session: Session) -> bool:
    """Write the page about trips to a fast charger; returns whether every trip was driven."""
    if session.short:
        drives = arrival_calls([FIRST_CAR], [MINUTE_VALUES_AIR_C], **SHORT)
        minutes: list[dict[str, Any]] = []
        evenings = evening_calls(**SHORT)
    else:
        drives, minutes, evenings = arrival_calls(), minute_calls(), evening_calls()
    names = [", ".join(map(str, call.values())) for call in (*drives, *minutes, *evenings)]
    found = session.compute(arrival, [*drives, *minutes], names)
    warm = session.compute(evening, evenings, names[len(found) :])
    if session.failures:
        return False
    values = charging_values(found[: len(drives)], found[len(drives) :], warm)
    session.render("charging_stop.md.j2", CHARGING_PAGE, **values)
    return True

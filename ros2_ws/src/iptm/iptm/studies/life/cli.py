"""The command behind ``scripts/life``: trips computed or found, years composed of them, and the page."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm.studies.campaign import Campaign
from iptm.studies.laboratory import Laboratory, Session
from iptm.studies.life.charging_page import CHARGING_PAGE, charging_page
from iptm.studies.life.charging_stop import (
    FIRST_CAR,
    MINUTE_VALUES_AIR_C,
    SHORT,
    arrivals,
    evenings,
    minute_values,
)
from iptm.studies.life.decisions import decision_study, decisions
from iptm.studies.life.own_law import priced_study
from iptm.studies.life.page import life_page
from iptm.studies.life.table import life_table
from iptm.studies.life.trips import START_C, trip_maps, trip_study
from iptm.studies.measured_cycles import TRIPS
from iptm_core.errors import ScenarioError

SHORT_START_C = (22.0, 36.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    short = "one minute of every trip; the page means nothing"
    laboratory = Laboratory("life", "life.md", __doc__, short)
    laboratory.parser.add_argument(
        "--charging-stop",
        action="store_true",
        help=f"instead, trips to a fast charger; writes {CHARGING_PAGE}, stores nothing",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    if session.options.charging_stop:
        return _charging_stop(session)
    short, log = session.options.short, session.console.print
    start_c = SHORT_START_C if short else START_C
    single, routes = decision_study(session.store.folder / "drives", log, 1 if short else TRIPS)
    studies = [trip_study(start_c), priced_study(start_c), single]
    if short:
        studies = [study.shortened(duration_s=60.0, compile_code=False) for study in studies]
    campaign = Campaign(studies)
    if not session.compute(campaign):
        return True
    missing = [state for state in campaign.cases if state.metrics is None]
    for state in missing:
        log(f"{state.address}: {state.reason}")
    if missing:
        return False
    log("years are composed ...")
    *of_years, single = studies
    trips = trip_maps(campaign.cases_of(*of_years), session.store)
    chosen = decisions(campaign.cases_of(single), routes, session.store, trips)
    session.write(life_page(session.command, life_table(trips), chosen))
    return True


def _charging_stop(session: Session) -> bool:
    options = session.options
    if options.stored or options.dry_run:
        raise ScenarioError(
            "--charging-stop with --stored or --dry-run; allowed: without, its trips are not stored"
        )
    session.console.print("drives to the charger ...")
    if options.short:
        drives = arrivals([FIRST_CAR], [MINUTE_VALUES_AIR_C], **SHORT)
        page = charging_page(session.command, drives, [], list(evenings(**SHORT)))
    else:
        page = charging_page(session.command, arrivals(), minute_values(), list(evenings()))
    session.write(page, CHARGING_PAGE)
    return True


if __name__ == "__main__":
    sys.exit(main())

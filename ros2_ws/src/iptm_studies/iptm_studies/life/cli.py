"""The command behind ``scripts/life``: trips computed or found, years composed of them, and the page."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm_core.errors import ScenarioError
from iptm_studies.campaign import Campaign
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.life import charging_stop
from iptm_studies.life.charging_page import CHARGING_PAGE, charging_page
from iptm_studies.life.decisions import decision_study, decisions
from iptm_studies.life.own_law import priced_study
from iptm_studies.life.page import life_page
from iptm_studies.life.table import life_table
from iptm_studies.life.trips import Extent, trip_maps, trip_study

_SHORT = Extent((22.0, 36.0), compile_code=False, duration_s=60.0, measured_trips=1)


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
    extent = _SHORT if session.options.short else Extent()
    single, routes = decision_study(extent, session.store.folder / "drives", session.console.print)
    campaign = Campaign([trip_study(extent), priced_study(extent), single])
    if not session.compute(campaign):
        return True
    missing = [state for state in campaign.cases if state.metrics is None]
    for state in missing:
        session.console.print(f"{state.address}: {state.reason}")
    if missing:
        return False
    session.console.print("years are composed ...")
    of_years = [state for state in campaign.cases if state.study is not single]
    trips = trip_maps(of_years, session.store)
    rows = life_table(trips)
    chosen = decisions(
        (state for state in campaign.cases if state.study is single),
        routes,
        session.store,
        trips,
    )
    session.write(life_page(session.command, rows, chosen))
    return True


def _charging_stop(session: Session) -> bool:
    if session.options.stored or session.options.dry_run:
        raise ScenarioError(
            "--charging-stop with --stored or --dry-run; allowed: without, its trips are not stored"
        )
    extent = charging_stop.SHORT if session.options.short else charging_stop.Extent()
    session.console.print("drives to the charger ...")
    text = charging_page(
        session.command,
        list(charging_stop.arrivals(extent)),
        list(charging_stop.worths(extent)),
        list(charging_stop.evenings(extent)),
    )
    session.write(text, CHARGING_PAGE)
    return True


if __name__ == "__main__":
    sys.exit(main())

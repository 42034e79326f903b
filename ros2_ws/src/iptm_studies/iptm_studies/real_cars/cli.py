"""The command behind ``scripts/real_cars``: runs computed or found, and the page about them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from iptm_studies.campaign import Campaign
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.real_cars.page import real_cars_page
from iptm_studies.real_cars.savings import CYCLE, Extent, savings_on, savings_study
from iptm_studies.real_cars.simplifications import losses, simplification_study, too_large
from iptm_studies.real_cars.trips import trip_cycles


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    laboratory = Laboratory(
        "real_cars", "real-cars.md", __doc__, short="a little of everything, in seconds"
    )
    laboratory.parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with recorded trips of the i3, the excerpts of the project by default",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    trips = trip_cycles(options.measured, store.folder / "trips", session.console.print)
    extent = Extent.short(trips) if options.short else Extent(tuple(trips))
    studies = savings_study(extent), simplification_study(extent)
    campaign = Campaign(studies)
    if not session.compute(campaign):
        return True
    savings, simplifications = (
        [state for state in campaign.cases if state.study is study] for study in studies
    )
    lost = losses(simplifications)
    for name in too_large(lost):
        print(f"simplification {name} costs more than it may")
    page = real_cars_page(
        session.command,
        extent,
        savings_on(extent, savings, [CYCLE]),
        savings_on(extent, savings, extent.trips),
        lost,
        campaign.failures,
        len(campaign.keys) - campaign.finished - len(campaign.failures),
    )
    session.write(page)
    return not (campaign.failures or too_large(lost))


if __name__ == "__main__":
    sys.exit(main())

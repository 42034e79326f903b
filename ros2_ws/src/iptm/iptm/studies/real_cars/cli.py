"""The command behind ``scripts/real_cars``: runs computed or found, and the page about them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from iptm.studies.campaign import Campaign
from iptm.studies.laboratory import Laboratory, Session
from iptm.studies.measured_cycles import trip_cycles
from iptm.studies.real_cars.page import real_cars_page
from iptm.studies.real_cars.savings import CARS, CLIMATES_C, CYCLE, savings_on, savings_study
from iptm.studies.real_cars.simplifications import losses, simplification_study, too_large


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
    if options.short:
        trips, cars = trips[:2], list(CARS[1:2])
        studies = [
            study.shortened(duration_s=20.0, compile_code=False)
            for study in (
                savings_study(trips, cars, CLIMATES_C[-1:]),
                simplification_study(CLIMATES_C[-1:], 1),
            )
        ]
    else:
        cars = list(CARS)
        studies = [savings_study(trips), simplification_study()]
    campaign = Campaign(studies)
    if not session.compute(campaign):
        return True
    savings, simplifications = map(campaign.cases_of, studies)
    lost = losses(simplifications)
    for name in too_large(lost):
        print(f"simplification {name} costs more than it may")
    page = real_cars_page(
        session.command,
        cars,
        len(trips),
        savings_on(savings, [CYCLE]),
        savings_on(savings, trips),
        lost,
        campaign.failures,
        len(campaign.keys) - campaign.finished - len(campaign.failures),
    )
    session.write(page)
    return not (campaign.failures or too_large(lost))


if __name__ == "__main__":
    sys.exit(main())

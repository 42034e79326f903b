"""The command behind ``scripts/safety``: trials driven or found, judged, and a page about them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from iptm_bringup.safety_trials.over_ros import drive_trials
from iptm_core.provenance import git_revision
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.safety.lead_vehicles import LEADS, lead_cycles
from iptm_studies.safety.page import safety_page
from iptm_studies.safety.performing import Part, perform
from iptm_studies.safety.trials import SHORT, Extent, disturbed_study

PAGE = "safety-trials.md"
ROS_TRIALS = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, 1 when something did not hold."""
    laboratory = Laboratory("safety", PAGE, __doc__, short="a little of everything, in seconds")
    parser = laboratory.parser
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        choices=[part.value for part in Part],
        help="only this part; repeatable",
    )
    for name, usual, text in (
        ("trials", Extent.trials, "disturbed trials"),
        ("braking", Extent.braking_trials, "trials with a braking lead vehicle"),
        ("ros", ROS_TRIALS, "of the disturbed trials that are driven over ROS 2 as well"),
        ("seed", Extent.seed, "seed of all draws"),
    ):
        parser.add_argument(f"--{name}", type=int, metavar="N", help=f"{text}, {usual} by default")
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help=f"folder with measured drives, of which {LEADS} lead vehicles are taken",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    extent = SHORT if options.short else Extent()
    given = {"trials": options.trials, "braking_trials": options.braking, "seed": options.seed}
    extent = replace(extent, **{name: value for name, value in given.items() if value is not None})
    if options.measured is not None or not options.short:
        leads = lead_cycles(options.measured, store.folder / "leads", session.console.print)
        extent = replace(extent, leads=tuple(leads))
    parts = [Part(name) for name in options.only or list(Part)]
    findings = perform(extent, parts, session)
    if findings is None:
        return True
    if Part.TRIALS in parts and not options.stored:
        count = options.ros if options.ros is not None else (0 if options.short else ROS_TRIALS)
        over_ros = drive_trials(
            disturbed_study(extent), count, store.folder / "ros", session.console
        )
        findings = replace(findings, over_ros=over_ros)
    broken = findings.broken()
    for line in broken:
        print(line)
    print(f"{len(broken)} did not hold")
    session.write(safety_page(session.command, git_revision(), findings))
    return not broken


if __name__ == "__main__":
    sys.exit(main())

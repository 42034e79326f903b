"""The command behind ``scripts/campaign``: random runs, computed or found, judged, and a page about them."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm_core.user_input import number, whole_number
from iptm_studies.campaign import Campaign
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.random_cars.draws import FAULT_SHARE, IMPERFECT_SHARE, TWIN, random_study
from iptm_studies.random_cars.page import JudgedRun, campaign_page, verdict_lines
from iptm_studies.random_cars.verdicts import judge
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.store import ResultStore

PAGE = "random-cars.md"
RUNS = 300
SEED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    laboratory = Laboratory("campaign", PAGE, __doc__)
    parser = laboratory.parser
    parser.add_argument(
        "--runs",
        type=whole_number,
        default=RUNS,
        metavar="N",
        help=f"number of runs, {RUNS} by default",
    )
    parser.add_argument(
        "--seed",
        type=whole_number,
        default=SEED,
        metavar="S",
        help=f"seed of all draws, {SEED} by default",
    )
    parser.add_argument(
        "--duration-s", type=number, metavar="T", help="length of all trips instead of those drawn"
    )
    parser.add_argument(
        "--without-twins",
        action="store_true",
        help="leave out the warm twins of cold runs, and the verdict on traction energy with them",
    )
    parser.add_argument(
        "--fault-share",
        type=float,
        default=FAULT_SHARE,
        metavar="P",
        help=f"share of the runs with faults, {FAULT_SHARE:g} by default",
    )
    parser.add_argument(
        "--imperfect-share",
        type=float,
        default=IMPERFECT_SHARE,
        metavar="P",
        help=f"share of the runs without a perfect preview, {IMPERFECT_SHARE:g} by default",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options = session.options
    study = random_study(
        options.runs,
        options.seed,
        options.duration_s,
        with_twins=not options.without_twins,
        fault_share=options.fault_share,
        imperfect_share=options.imperfect_share,
    )
    campaign = Campaign([study])
    if not session.compute(campaign):
        return True
    runs = judged_runs(campaign, session.store)
    for line in verdict_lines(runs):
        print(line)
    session.write(campaign_page(session.command, runs))
    return all(run.judgement is not None and not run.judgement.breaches for run in runs)


def judged_runs(campaign: Campaign, store: ResultStore) -> list[JudgedRun]:
    """Judge the runs of a campaign of random cars, each with its twin if it has one."""
    keys = {
        state.case.name: str(state.key) for state in campaign.cases if state.metrics is not None
    }
    judged = []
    for state in campaign.cases:
        name, spec = state.case.name, state.case.spec
        if name.endswith(TWIN):
            continue
        if name not in keys:
            judged.append(JudgedRun(name, spec, None, state.reason))
            continue
        twin_key = keys.get(f"{name}_{TWIN}")
        twin = None if twin_key is None else store.load(twin_key)
        found = judge(store.load(keys[name]), resolve_inputs(spec), twin)
        judged.append(JudgedRun(name, spec, found))
    return judged


if __name__ == "__main__":
    sys.exit(main())

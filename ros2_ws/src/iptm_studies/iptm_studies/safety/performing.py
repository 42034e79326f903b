"""Performs the safety trials without ROS: what is stored is not driven again."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_core.errors import StoreError
from iptm_studies.campaign import NOT_COMPUTED, Campaign, CaseState
from iptm_studies.laboratory import Session
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.safety.braking import BrakingOutcomes, BrakingResults
from iptm_studies.safety.findings import Before, Driven, Findings, JudgedTrial
from iptm_studies.safety.judging import judge_trial
from iptm_studies.safety.trials import (
    UNDISTURBED,
    Extent,
    delay_study,
    disturbed_study,
    driving_study,
)
from iptm_studies.store import ResultStore

BEFORE = Path(__file__).parent / "before.json"
"""Savings of an earlier version; the file names it."""


class Part(TextEnum):
    """A part of the trials."""

    DRIVING = "driving"
    BRAKING = "braking"
    TRIALS = "trials"
    DELAYS = "delays"


def perform(extent: Extent, parts: Collection[Part], session: Session) -> Findings | None:
    """Drive what is missing of some parts and return everything that was found.

    Returns:
        The findings; None if the session was only to show the runs.
    """
    studies = {
        Part.DRIVING: driving_study(extent),
        Part.TRIALS: disturbed_study(extent),
        Part.DELAYS: delay_study(extent),
    }
    # The monitor brakes from instants of undisturbed drives.
    needed = {Part.DRIVING if part is Part.BRAKING else part for part in parts}
    campaign = Campaign([study for part, study in studies.items() if part in needed])
    if not session.compute(campaign):
        return None
    states = {
        part: [state for state in campaign.cases if state.study is study]
        for part, study in studies.items()
    }
    stored_only = session.options.stored
    return Findings(
        _braking(states[Part.DRIVING], extent, session) if Part.BRAKING in parts else {},
        [
            _judged(state, session.store)
            for state in states[Part.TRIALS]
            if not (stored_only and state.reason == NOT_COMPUTED)
        ],
        (),
        _driven(states[Part.DRIVING]) if Part.DRIVING in parts else (),
        _driven(states[Part.DELAYS]),
        # Savings of a part of a cycle compare with nothing.
        read_before(BEFORE) if math.isinf(extent.longest_s) else Before(),
    )


def _braking(
    driving: Iterable[CaseState], extent: Extent, session: Session
) -> dict[str, BrakingOutcomes]:
    drives = {
        str(state.case.labels["cycle"]): (
            resolve_inputs(state.case.spec),
            session.store.load(str(state.key)).trajectory,
        )
        for state in driving
        if state.case.labels["setting"] == UNDISTURBED and state.metrics is not None
    }
    return BrakingResults(session.store.folder / "braking").complete(
        drives,
        extent.braking_trials,
        extent.seed,
        0 if session.options.stored else session.workers,
        lambda name: session.console.print(f"braking lead vehicle: {name}"),
    )


def _judged(state: CaseState, store: ResultStore) -> JudgedTrial:
    case = state.case
    disturbed, faults = str(case.labels["disturbed"]), case.spec.faults
    what = f"{case.labels['cycle']}, {', '.join(fault.describe() for fault in faults)}"
    if state.metrics is None:
        return JudgedTrial(case.name, disturbed, what, faults, None, state.reason)
    run = store.load(str(state.key))
    verdict = judge_trial(run.trajectory, run.parameters, faults, run.reports)
    return JudgedTrial(case.name, disturbed, what, faults, verdict)


def _driven(states: Iterable[CaseState]) -> list[Driven]:
    return [
        Driven(state.case.labels, state.metrics) for state in states if state.metrics is not None
    ]


def read_before(path: Path) -> Before:
    """Read the savings of an earlier version.

    Raises:
        StoreError: the file cannot be read.
    """
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return Before(content["about"], content["savings_percent"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path} cannot be read: {error}") from None

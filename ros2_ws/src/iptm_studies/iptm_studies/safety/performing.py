"""Performs the safety trials without ROS: what is stored is not driven again."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from iptm_core.errors import StoreError
from iptm_core.text_enum import TextEnum
from iptm_studies.campaign import NOT_COMPUTED, Campaign, CaseState
from iptm_studies.cli import compute
from iptm_studies.cluster import ClusterOptions
from iptm_studies.execution import survey
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


@dataclass(frozen=True)
class Performer:
    """Drives parts of the trials.

    Attributes:
        extent: how much is driven.
        store: where runs are found and put.
        cluster: where to perform them.
        console: shows the progress.
        stored_only: nothing is driven; what is stored is judged.
    """

    extent: Extent
    store: ResultStore
    cluster: ClusterOptions
    console: Console
    stored_only: bool = False

    def perform(self, parts: Collection[Part]) -> Findings:
        """Drive what is missing of some parts and return everything that was found."""
        extent = self.extent
        studies = {
            Part.DRIVING: driving_study(extent),
            Part.TRIALS: disturbed_study(extent),
            Part.DELAYS: delay_study(extent),
        }
        # The monitor brakes from instants of undisturbed drives.
        needed = {Part.DRIVING if part is Part.BRAKING else part for part in parts}
        campaign = Campaign([study for part, study in studies.items() if part in needed])
        if self.stored_only:
            survey(campaign, self.store)
        else:
            compute(campaign, self.store, self.cluster, self.console)
        states = {
            part: [state for state in campaign.cases if state.study is study]
            for part, study in studies.items()
        }
        return Findings(
            self._braking(states[Part.DRIVING]) if Part.BRAKING in parts else {},
            [
                self._judged(state)
                for state in states[Part.TRIALS]
                if not (self.stored_only and state.reason == NOT_COMPUTED)
            ],
            (),
            _driven(states[Part.DRIVING]) if Part.DRIVING in parts else (),
            _driven(states[Part.DELAYS]),
            # Savings of a part of a cycle compare with nothing.
            read_before(BEFORE) if math.isinf(extent.longest_s) else Before(),
        )

    def _braking(self, driving: Iterable[CaseState]) -> dict[str, BrakingOutcomes]:
        drives = {
            str(state.case.labels["cycle"]): (
                resolve_inputs(state.case.spec),
                self.store.load(str(state.key)).trajectory,
            )
            for state in driving
            if state.case.labels["setting"] == UNDISTURBED and state.metrics is not None
        }
        return BrakingResults(self.store.folder / "braking").complete(
            drives,
            self.extent.braking_trials,
            self.extent.seed,
            None if self.stored_only else self.cluster,
            lambda name: self.console.print(f"braking lead vehicle: {name}"),
        )

    def _judged(self, state: CaseState) -> JudgedTrial:
        case = state.case
        disturbed, faults = str(case.labels["disturbed"]), case.spec.faults
        what = f"{case.labels['cycle']}, {', '.join(fault.describe() for fault in faults)}"
        if state.metrics is None:
            return JudgedTrial(case.name, disturbed, what, faults, None, state.reason)
        run = self.store.load(str(state.key))
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

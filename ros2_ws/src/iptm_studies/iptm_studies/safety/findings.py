"""What safety trials found, driven or from the store, and what of it must hold."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_core.errors import StoreError
from iptm_core.metrics import RunMetrics, at_equal_end, figure_values
from iptm_core.parameters import load_parameters
from iptm_studies.campaign import NOT_COMPUTED, Campaign, CaseState
from iptm_studies.laboratory import Session
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.safety.braking import BrakingOutcomes, braking_outcomes
from iptm_studies.safety.judging import judge_trial, trial_of
from iptm_studies.safety.trials import (
    NOISE_AND_DELAY,
    REFERENCE,
    UNDISTURBED,
    Extent,
    delay_study,
    disturbed_study,
    driving_study,
)
from iptm_studies.store import ResultStore
from iptm_studies.study import Judged

BEFORE = Path(__file__).parent / "before.json"
"""Savings of an earlier version; the file names it."""
AGING = "total_degradation"
ALLOWED_FALL_POINTS = {UNDISTURBED: 0.1, NOISE_AND_DELAY: 1.0, "preview errors": 3.0}
ALLOWED_PER_HOUR = {UNDISTURBED: 0.0, NOISE_AND_DELAY: 1.0}
ALLOWED_BELOW_M = 0.5
ALLOWED_NOISE_BELOW_M = 0.3
ALLOWED_ENERGY_PERCENT = 2.0

Savings = Mapping[str, Mapping[str, float]]
"""Battery ageing saved in percent, by cycle and setting."""


class Part(TextEnum):
    """A part of the trials."""

    DRIVING = "driving"
    BRAKING = "braking"
    TRIALS = "trials"
    DELAYS = "delays"


@dataclass(frozen=True)
class Findings:
    """Everything that the trials found.

    Attributes:
        braking: trials of the monitor alone, by drive.
        trials: disturbed trials.
        driving: drives without events by cycle, setting and whether the lead vehicle was measured.
        delays: drives with delayed commands by cycle, period and ticks of delay.
        before: savings of an earlier version, and where they come from.
        over_ros: disturbed trials over ROS 2.
    """

    braking: Mapping[str, BrakingOutcomes]
    trials: Sequence[Judged]
    driving: Mapping[tuple[str, str, bool], RunMetrics]
    delays: Mapping[tuple[str, float, int], RunMetrics]
    before: tuple[Savings, str] = field(default=({}, ""))
    over_ros: Sequence[Judged] = ()

    def broken(self) -> list[str]:
        """Return what did not hold, one line each."""
        lines = [
            f"braking lead vehicle, {name}: {int(found.avoidable.sum())} avoidable collisions"
            for name, found in self.braking.items()
            if found.avoidable.any()
        ]
        lines += [
            f"trial {trial.name}: {trial.problem_text}"
            for trial in (*self.trials, *self.over_ros)
            if trial.problems
        ]
        return [*lines, *_driving_problems(self), *_delay_problems(self)]


def perform(extent: Extent, parts: Collection[Part], session: Session) -> Findings | None:
    """Drive what is missing of some parts without ROS and return everything that was found.

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
        {
            (str(label["cycle"]), str(label["setting"]), "measured" in label): metrics
            for label, metrics in _driven(states[Part.DRIVING])
            if Part.DRIVING in parts
        },
        {
            (str(label["cycle"]), float(label["period_s"]), int(label["ticks"])): metrics
            for label, metrics in _driven(states[Part.DELAYS])
        },
        # Savings of a part of a cycle compare with nothing.
        read_before(BEFORE) if math.isinf(extent.longest_s) else ({}, ""),
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
    return braking_outcomes(
        ResultStore(session.store.folder / "braking"),
        drives,
        extent.braking_trials,
        extent.seed,
        0 if session.options.stored else session.workers,
        lambda name: session.console.print(f"braking lead vehicle: {name}"),
    )


def _judged(state: CaseState, store: ResultStore) -> Judged:
    if state.metrics is None:
        return trial_of(state.case, failure=state.reason)
    run, faults = store.load(str(state.key)), state.case.spec.faults
    trial = trial_of(state.case)
    return judge_trial(trial, run.trajectory, run.parameters, faults, run.reports)


def _driven(states: Iterable[CaseState]) -> Iterator[tuple[Mapping[str, Any], RunMetrics]]:
    for state in states:
        if state.metrics is not None:
            yield state.case.labels, state.metrics


def read_before(path: Path) -> tuple[Savings, str]:
    """Read the savings of an earlier version, and where they come from.

    Raises:
        StoreError: the file cannot be read.
    """
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return content["savings_percent"], content["about"]
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path} cannot be read: {error}") from None


def hours(driven: Iterable[RunMetrics]) -> float:
    """Return the time driven in h."""
    return sum(one.duration_s for one in driven) / 3600.0


def by_setting(findings: Findings, *, measured: bool) -> dict[str, list[RunMetrics]]:
    """Return drives by what is disturbed, those behind measured lead vehicles or the others."""
    groups: defaultdict[str, list[RunMetrics]] = defaultdict(list)
    for (_, setting, is_measured), metrics in findings.driving.items():
        if is_measured is measured and setting != REFERENCE:
            groups[setting].append(metrics)
    return groups


def smallest_margin_m(driven: Iterable[RunMetrics]) -> float:
    """Return the smallest margin to s_min in m."""
    return min(figure_values(one)["smallest_margin"] for one in driven)


def fallbacks(driven: Iterable[RunMetrics]) -> int:
    """Return the number of ticks on a fallback."""
    return sum(one.decisions.fallbacks for one in driven if one.decisions)


def savings_percent(findings: Findings) -> dict[str, dict[str, float]]:
    """Return the battery ageing saved against the undisturbed reference, by cycle and setting."""
    ageing: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for (cycle, setting, is_measured), metrics in findings.driving.items():
        if not is_measured:
            ageing[cycle][setting] = figure_values(metrics)[AGING]
    return {
        cycle: {
            name: 100.0 * (1.0 - value / values[REFERENCE])
            for name, value in values.items()
            if name != REFERENCE
        }
        for cycle, values in ageing.items()
        if REFERENCE in values
    }


def _driving_problems(findings: Findings) -> Iterator[str]:
    for measured in (False, True):
        for setting, group in by_setting(findings, measured=measured).items():
            count = sum(one.interventions for one in group)
            allowed = ALLOWED_PER_HOUR.get(setting, math.inf)
            if count > allowed * hours(group):
                yield (
                    f"{setting}: {count} interventions in {hours(group):.2f} h; allowed: {allowed:g} per hour"
                )
    for cycle, savings in savings_percent(findings).items():
        before = findings.before[0].get(cycle, {})
        for name, allowed in ALLOWED_FALL_POINTS.items():
            if name in savings and before.get(UNDISTURBED, 0.0) - savings[name] > allowed:
                alike = (
                    f", {before[name]:.2f} % with the same disturbance" if name in before else ""
                )
                yield (
                    f"{cycle}, {name}: saving of {savings[name]:.2f} %; before {before[UNDISTURBED]:.2f} % "
                    f"undisturbed{alike}; allowed: {allowed:g} points less than undisturbed"
                )
    noisy = by_setting(findings, measured=False).get("noise", [])
    if noisy and fallbacks(noisy):
        yield f"noise: {fallbacks(noisy)} ticks on a fallback; allowed: none"
    if noisy and smallest_margin_m(noisy) < -ALLOWED_NOISE_BELOW_M:
        yield (
            f"noise: s_min broken by {-smallest_margin_m(noisy):.2f} m; allowed: {ALLOWED_NOISE_BELOW_M:g} m"
        )


def by_period(findings: Findings) -> dict[tuple[str, float], dict[int, RunMetrics]]:
    """Return drives with delayed commands by cycle and period, and in these by ticks of delay."""
    groups: defaultdict[tuple[str, float], dict[int, RunMetrics]] = defaultdict(dict)
    for (cycle, period_s, ticks), metrics in findings.delays.items():
        groups[cycle, period_s][ticks] = metrics
    return groups


def energy_percent(group: Mapping[int, RunMetrics], ticks: int) -> float:
    """Return the change of battery energy against no delay with equal ends, NaN without such a drive.

    The beginnings of cycles end warm and in motion: both packs are cooled to one temperature, and the
    kinetic energy is returned.
    """
    if 0 not in group:
        return math.nan
    ends = at_equal_end(group[ticks], group[0], load_parameters().values)
    return math.nan if ends is None else 100.0 * (ends[0].energy_j / ends[1].energy_j - 1.0)


def _delay_problems(findings: Findings) -> Iterator[str]:
    for (cycle, period_s), group in by_period(findings).items():
        for ticks, metrics in group.items():
            where = f"{cycle}, {period_s:g} s, {ticks} ticks late"
            values = figure_values(metrics)
            if values["smallest_gap"] <= 0.0:
                yield f"{where}: collision"
            if values["smallest_margin"] < -ALLOWED_BELOW_M:
                yield (
                    f"{where}: s_min broken by {-values['smallest_margin']:.2f} m; "
                    f"allowed: {ALLOWED_BELOW_M:g} m"
                )
            if ticks and not abs(energy_percent(group, ticks)) <= ALLOWED_ENERGY_PERCENT:
                yield (
                    f"{where}: battery energy {energy_percent(group, ticks):+.1f} %; "
                    f"allowed: {ALLOWED_ENERGY_PERCENT:g} %"
                )

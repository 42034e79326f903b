"""What safety trials found, and what of it must hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from iptm_core.metrics import RunMetrics, at_equal_end, figure_values
from iptm_core.parameters import load_parameters
from iptm_faults.fault import Fault
from iptm_studies.safety.braking import BrakingOutcomes
from iptm_studies.safety.judging import Verdict
from iptm_studies.safety.trials import NOISE_AND_DELAY, REFERENCE, UNDISTURBED
from iptm_studies.study import Label

AGING = "total_degradation"
ALLOWED_FALL_POINTS = {UNDISTURBED: 0.1, NOISE_AND_DELAY: 1.0, "preview errors": 3.0}
ALLOWED_PER_HOUR = {UNDISTURBED: 0.0, NOISE_AND_DELAY: 1.0}
ALLOWED_BELOW_M = 0.5
ALLOWED_NOISE_BELOW_M = 0.3
ALLOWED_ENERGY_PERCENT = 2.0


@dataclass(frozen=True)
class JudgedTrial:
    """A disturbed trial and what became of it.

    Attributes:
        name: of its case, and how it was driven.
        disturbed: what was disturbed, comma-separated, the event first.
        what: its specification in words.
        faults: what went wrong.
        verdict: on it; None for a trial that failed.
        failure: why it failed.
    """

    name: str
    disturbed: str
    what: str
    faults: tuple[Fault, ...]
    verdict: Verdict | None
    failure: str = ""

    @property
    def problems(self) -> tuple[str, ...]:
        """What did not hold."""
        return (self.failure,) if self.verdict is None else self.verdict.problems


@dataclass(frozen=True)
class Driven:
    """A drive without events: its labels and figures."""

    labels: Mapping[str, Label]
    metrics: RunMetrics


@dataclass(frozen=True)
class Before:
    """Savings of an earlier version, in percent by cycle and setting, and where they come from."""

    about: str = ""
    savings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Findings:
    """Everything that the trials found."""

    braking: Mapping[str, BrakingOutcomes]
    trials: Sequence[JudgedTrial]
    over_ros: Sequence[JudgedTrial]
    driving: Sequence[Driven]
    delays: Sequence[Driven]
    before: Before

    def broken(self) -> list[str]:
        """Return what did not hold, one line each."""
        lines = [
            f"braking lead vehicle, {name}: {int(found.avoidable.sum())} avoidable collisions"
            for name, found in self.braking.items()
            if found.avoidable.any()
        ]
        lines += [
            f"trial {trial.name}: {', '.join(trial.problems)}"
            for trial in (*self.trials, *self.over_ros)
            if trial.problems
        ]
        return lines + _driving_problems(self) + _delay_problems(self)


def hours(driven: Iterable[Driven]) -> float:
    """Return the time driven in h."""
    return sum(one.metrics.duration_s for one in driven) / 3600.0


def _is_measured(one: Driven) -> bool:
    return bool(one.labels.get("measured"))


def by_setting(driving: Iterable[Driven], *, measured: bool) -> dict[str, list[Driven]]:
    """Return drives by what is disturbed, those behind measured lead vehicles or the others."""
    groups: dict[str, list[Driven]] = {}
    for one in driving:
        if _is_measured(one) is measured and one.labels["setting"] != REFERENCE:
            groups.setdefault(str(one.labels["setting"]), []).append(one)
    return groups


def smallest_margin_m(driven: Iterable[Driven]) -> float:
    """Return the smallest margin to s_min in m."""
    return min(figure_values(one.metrics)["smallest_margin"] for one in driven)


def fallbacks(driven: Iterable[Driven]) -> int:
    """Return the number of ticks on a fallback."""
    return sum(one.metrics.decisions.fallbacks for one in driven if one.metrics.decisions)


def savings_percent(driving: Iterable[Driven]) -> dict[str, dict[str, float]]:
    """Return the battery ageing saved against the undisturbed reference, by cycle and setting."""
    ageing: dict[str, dict[str, float]] = {}
    for one in driving:
        if not _is_measured(one):
            of_cycle = ageing.setdefault(str(one.labels["cycle"]), {})
            of_cycle[str(one.labels["setting"])] = figure_values(one.metrics)[AGING]
    return {
        cycle: {
            name: 100.0 * (1.0 - value / values[REFERENCE])
            for name, value in values.items()
            if name != REFERENCE
        }
        for cycle, values in ageing.items()
        if REFERENCE in values
    }


def _driving_problems(findings: Findings) -> list[str]:
    problems = []
    for measured in (False, True):
        for setting, group in by_setting(findings.driving, measured=measured).items():
            count = sum(one.metrics.interventions for one in group)
            allowed = ALLOWED_PER_HOUR.get(setting, math.inf)
            if count > allowed * hours(group):
                problems.append(
                    f"{setting}: {count} interventions in {hours(group):.2f} h; allowed: {allowed:g} per hour"
                )
    for cycle, savings in savings_percent(findings.driving).items():
        before = findings.before.savings.get(cycle, {})
        for name, allowed in ALLOWED_FALL_POINTS.items():
            if name in savings and before.get(UNDISTURBED, 0.0) - savings[name] > allowed:
                alike = (
                    f", {before[name]:.2f} % with the same disturbance" if name in before else ""
                )
                problems.append(
                    f"{cycle}, {name}: saving of {savings[name]:.2f} %; before {before[UNDISTURBED]:.2f} % "
                    f"undisturbed{alike}; allowed: {allowed:g} points less than undisturbed"
                )
    noisy = by_setting(findings.driving, measured=False).get("noise", [])
    if noisy and fallbacks(noisy):
        problems.append(f"noise: {fallbacks(noisy)} ticks on a fallback; allowed: none")
    if noisy and smallest_margin_m(noisy) < -ALLOWED_NOISE_BELOW_M:
        problems.append(
            f"noise: s_min broken by {-smallest_margin_m(noisy):.2f} m; allowed: {ALLOWED_NOISE_BELOW_M:g} m"
        )
    return problems


def by_period(delays: Iterable[Driven]) -> dict[tuple[str, float], dict[int, Driven]]:
    """Return drives with delayed commands by cycle and period, and in these by ticks of delay."""
    groups: dict[tuple[str, float], dict[int, Driven]] = {}
    for one in delays:
        key = str(one.labels["cycle"]), float(one.labels["period_s"])
        groups.setdefault(key, {})[int(one.labels["ticks"])] = one
    return groups


def energy_percent(group: Mapping[int, Driven], ticks: int) -> float:
    """Return the change of battery energy against no delay with equal ends, NaN without such a drive.

    The beginnings of cycles end warm and in motion: both packs are cooled to one temperature, and the
    kinetic energy is returned.
    """
    if 0 not in group:
        return math.nan
    ends = at_equal_end(group[ticks].metrics, group[0].metrics, load_parameters().values)
    return math.nan if ends is None else 100.0 * (ends.own.energy_j / ends.other.energy_j - 1.0)


def _delay_problems(findings: Findings) -> list[str]:
    problems = []
    for (cycle, period_s), group in by_period(findings.delays).items():
        for ticks, one in group.items():
            where = f"{cycle}, {period_s:g} s, {ticks} ticks late"
            values = figure_values(one.metrics)
            if values["smallest_gap"] <= 0.0:
                problems.append(f"{where}: collision")
            if values["smallest_margin"] < -ALLOWED_BELOW_M:
                problems.append(
                    f"{where}: s_min broken by {-values['smallest_margin']:.2f} m; "
                    f"allowed: {ALLOWED_BELOW_M:g} m"
                )
            if ticks and not abs(energy_percent(group, ticks)) <= ALLOWED_ENERGY_PERCENT:
                problems.append(
                    f"{where}: battery energy {energy_percent(group, ticks):+.1f} %; "
                    f"allowed: {ALLOWED_ENERGY_PERCENT:g} %"
                )
    return problems

"""What safety trials found, driven or from the store, and what of it must hold."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from studies.drives import REFERENCE
from studies.judged import Judged
from studies.safety.trials import NOISE_AND_DELAY, SHIPPED, UNDISTURBED

from iptm_core.errors import StoreError
from iptm_core.metrics.figures import figure_values
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saving import at_equal_end
from iptm_core.parameters import load_parameters

BEFORE = Path(__file__).parent / "before.json"
"""Savings of an earlier version; the file names it."""
ALLOWED_FALL_POINTS = {UNDISTURBED: 0.1, NOISE_AND_DELAY: 1.0, "preview errors": 3.0}
ALLOWED_PER_HOUR = {UNDISTURBED: 0.0, NOISE_AND_DELAY: 1.0}
ALLOWED_BELOW_M = 0.5
ALLOWED_NOISE_BELOW_M = 0.3
ALLOWED_ENERGY_PERCENT = 2.0

Savings = Mapping[str, Mapping[str, float]]
"""Battery ageing saved in percent, by cycle and setting."""


@dataclass(frozen=True)
class Findings:
    """Everything that the trials found.

    Attributes:
        braking: trials of the monitor alone, see `braking_outcomes`.
        trials: disturbed trials.
        driving: drives without events, see `with_figures`.
        delays: drives with delayed commands, see `delays_of`.
        before: savings of an earlier version, and where they come from.
        over_ros: disturbed trials over ROS 2.
    """

    braking: pd.DataFrame
    trials: Sequence[Judged]
    driving: pd.DataFrame
    delays: pd.DataFrame
    before: tuple[Savings, str] = ({}, "")
    over_ros: Sequence[Judged] = ()

    def broken(self) -> list[str]:
        """Return what did not hold, one line each."""
        avoidable = self.braking.groupby("drive", sort=False).avoidable.sum()
        lines = [
            f"braking lead vehicle, {name}: {count} avoidable collisions"
            for name, count in avoidable[avoidable > 0].items()
        ]
        lines += [
            f"trial {trial.name}: {trial.problem_text}"
            for trial in (*self.trials, *self.over_ros)
            if trial.problems
        ]
        return [*lines, *_driving_problems(self), *_delay_problems(self.delays)]


def with_figures(drives: pd.DataFrame) -> pd.DataFrame:
    """Return the finished drives: a row per drive with its labels, ``metrics`` and figures."""
    found = drives[drives.metrics.notna()].reset_index(drop=True)
    return found.join(pd.DataFrame([figure_values(metrics) for metrics in found.metrics]))


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


def by_setting(driving: pd.DataFrame) -> pd.DataFrame:
    """Sum up drives by what is disturbed.

    Returns:
        A row per ``behind`` (shipped cycles, measured lead vehicles) and ``setting``: number of ``drives``,
        ``hours``, ``interventions`` and these ``per_hour``, ticks on ``fallbacks`` and ``margin_m``, the
        smallest margin to s_min.
    """
    if driving.empty:
        return pd.DataFrame(columns=["setting"])
    disturbed = driving[driving.setting != REFERENCE]
    found = disturbed.groupby(["behind", "setting"], sort=False).agg(
        drives=("cycle", "size"),
        hours=("duration", lambda seconds: seconds.sum() / 3600.0),
        interventions=("interventions", "sum"),
        fallbacks=("fallbacks", "sum"),
        margin_m=("smallest_margin", "min"),
    )
    whole = {"interventions": int, "fallbacks": int}
    return found.assign(per_hour=found.interventions / found.hours).astype(whole).reset_index()


def savings_percent(driving: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return the battery ageing saved against the undisturbed reference, by cycle and setting."""
    found: dict[str, dict[str, float]] = {}
    if driving.empty:
        return found
    for cycle, part in driving[driving.behind == SHIPPED].groupby("cycle", sort=False):
        ageing = part.set_index("setting").total_degradation
        if REFERENCE in ageing:
            saved = 100.0 * (1.0 - ageing / ageing[REFERENCE])
            found[cycle] = saved.drop(REFERENCE).to_dict()
    return found


def _driving_problems(findings: Findings) -> Iterator[str]:
    sums = by_setting(findings.driving)
    for row in sums.itertuples():
        allowed = ALLOWED_PER_HOUR.get(row.setting, math.inf)
        if row.interventions > allowed * row.hours:
            yield (
                f"{row.setting}: {row.interventions} interventions in {row.hours:.2f} h; "
                f"allowed: {allowed:g} per hour"
            )
    for cycle, savings in savings_percent(findings.driving).items():
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
    for row in sums[sums.setting == "noise"].itertuples():
        if row.fallbacks:
            yield f"noise: {row.fallbacks} ticks on a fallback; allowed: none"
        if row.margin_m < -ALLOWED_NOISE_BELOW_M:
            yield f"noise: s_min broken by {-row.margin_m:.2f} m; allowed: {ALLOWED_NOISE_BELOW_M:g} m"


def delays_of(drives: pd.DataFrame) -> pd.DataFrame:
    """Return the drives with delayed commands.

    Returns:
        The rows of `with_figures`, and ``energy_percent``: change of energy against no delay with equal ends,
        NaN without such a drive. The beginnings of cycles end warm and in motion: both packs are cooled to
        one temperature, and the kinetic energy is returned.
    """
    found = with_figures(drives)
    if found.empty:
        return found
    in_time = {
        (row.cycle, row.period_s): row.metrics for row in found[found.ticks == 0].itertuples()
    }
    energy = [
        energy_percent(row.metrics, in_time.get((row.cycle, row.period_s)))
        for row in found.itertuples()
    ]
    return found.assign(energy_percent=energy)


def energy_percent(own: RunMetrics, other: RunMetrics | None) -> float:
    """Return the change of battery energy against another drive with equal ends, NaN without it."""
    if other is None:
        return math.nan
    ends = at_equal_end(own, other, load_parameters().values)
    return math.nan if ends is None else 100.0 * (ends[0].energy_j / ends[1].energy_j - 1.0)


def _delay_problems(delays: pd.DataFrame) -> Iterator[str]:
    for row in delays.itertuples():
        where = f"{row.cycle}, {row.period_s:g} s, {row.ticks} ticks late"
        if row.smallest_gap <= 0.0:
            yield f"{where}: collision"
        if row.smallest_margin < -ALLOWED_BELOW_M:
            yield (
                f"{where}: s_min broken by {-row.smallest_margin:.2f} m; allowed: {ALLOWED_BELOW_M:g} m"
            )
        if row.ticks and not abs(row.energy_percent) <= ALLOWED_ENERGY_PERCENT:
            yield (
                f"{where}: battery energy {row.energy_percent:+.1f} %; "
                f"allowed: {ALLOWED_ENERGY_PERCENT:g} %"
            )

"""What must hold in every run of a campaign, how it is measured, and why it did not hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from studies.judged import Judged
from studies.session import inputs_of

from iptm import Run
from iptm.parts import (
    CELSIUS_ZERO_K,
    BoolArray,
    Fault,
    FloatArray,
    Horizon,
    PreviewSettings,
    Rung,
    ScenarioError,
    SolveStatus,
    Trajectory,
    avoidable_collisions,
    avoidably_below_s_min,
    below_s_min,
    cold_compressor_energies_j,
    episodes,
    fully_cooled_k,
    gap_margins_m,
    parameter_specs,
    read_yaml,
)

OVERHEATED_BY_K = 0.5
PARTED_M_S = 0.3
"""Difference of two speeds from which on they are different drives."""
SMALL_TRIP_J = 1e5
UNFORESEEN_M = 0.1
SLACK_M = 0.01
RECOVERY_TICKS = 5
TICKS = "ticks"
"""Figure of the number of decisions."""


@dataclass(frozen=True)
class Requirement:
    """One thing that must hold.

    Attributes:
        title: what is looked for.
        rule: how its amount is measured.
        unit: unit of the amount.
        limit: largest permitted amount; infinite if only reported.
    """

    title: str
    rule: str
    unit: str
    limit: float = math.inf

    @property
    def is_report(self) -> bool:
        """Whether the amount is only reported."""
        return math.isinf(self.limit)


def _read_requirements() -> dict[str, Requirement]:
    path = Path(__file__).parent / "requirements.yaml"
    written: Mapping[str, Any] = read_yaml(path, ScenarioError)
    found = {}
    for key, content in written.items():
        rule = content["rule"].format(
            unforeseen_m=f"{UNFORESEEN_M:g}",
            recovery_ticks=RECOVERY_TICKS,
            overheated_by_k=f"{OVERHEATED_BY_K:g}",
        )
        found[key] = Requirement(**{**content, "rule": rule})
    return found


REQUIREMENTS = _read_requirements()
"""What is judged, by key, in the order of the table."""


def trial_of(name: str, inputs: Any, failure: str = "") -> Judged:
    """Return a run that is not judged yet, or that failed."""
    problems = {"failed": failure} if failure else {}
    return Judged(name, inputs.heading, problems=problems)


def judge(name: str, run: Run, call: Mapping[str, Any], warm_twin: Run | None = None) -> Judged:
    """Judge a run of a closed loop.

    Figures are the amounts by requirement, without those that do not apply, and the number of ``ticks``;
    problems are causes by requirement; counts are fallback ticks by rung and status of the solve.

    Args:
        name: of its case.
        run: the run.
        call: the arguments of `iptm.simulate` that it was made from.
        warm_twin: the same trip on a hot day without temperature limits, None if there is none.
    """
    inputs = inputs_of(call)
    imperfections = {spec.name for spec in parameter_specs(PreviewSettings)}
    usual = inputs_of({key: value for key, value in call.items() if key not in imperfections})
    own_faults = inputs.conditions.faults
    informed = not own_faults and inputs.preview == usual.preview
    trip = run.trajectory
    amounts: dict[str, float] = {TICKS: len(trip) - 1}
    causes: dict[str, str] = {}
    for key, rows in _gap_rows(run, inputs.controller.horizon, informed=informed).items():
        amounts[key] = float(np.count_nonzero(rows))
        if rows.any():
            margin_m = gap_margins_m(trip, run.parameters)[rows].min()
            causes[key] = (
                f"{-margin_m:.1f} m below s_min, gap {trip.gap_m[rows].min():.1f} m, "
                + _circumstances(run, rows)
            )

    broken = [check for check in run.metrics.constraints if check.hard and check.key != "collision"]
    amounts["hard"] = float(sum(check.violations for check in broken))
    causes["hard"] = ", ".join(
        f"{check.label} by {check.worst_excess:.3g} {check.unit} at {check.worst_time_s:g} s"
        for check in broken
        if check.violations
    )

    unexplained = ~_explained_by_faults(trip, trip.time_s, own_faults)
    energy_j = cold_compressor_energies_j(trip, run.parameters) * unexplained
    amounts["cold_compressor"] = 1e-3 * float(energy_j.sum())
    if (running := energy_j > 1.0).any():
        power = f"up to {trip.compressor_power_w[running].max():.0f} W, "
        causes["cold_compressor"] = power + _circumstances(run, running)

    if warm_twin is not None:
        here_j, there_j = (one.metrics.traction_energy_j for one in (run, warm_twin))
        amounts["cold_traction"] = 100.0 * (here_j - there_j) / max(abs(there_j), SMALL_TRIP_J)
        causes["cold_traction"] = (
            f"{1e-3 * here_j:.0f} kJ instead of {1e-3 * there_j:.0f} kJ, "
            + _parting(trip, warm_twin.trajectory)
        )

    fallbacks, emergencies = _fallbacks(run, own_faults)
    amounts |= {"emergency": float(emergencies), "fallback": float(fallbacks.total())}
    causes["fallback"] = _counted(fallbacks)
    _judge_heat(run, inputs, amounts, causes)
    problems = {
        key: causes.get(key, "")
        for key, amount in amounts.items()
        if key != TICKS and amount > REQUIREMENTS[key].limit
    }
    what = trial_of(name, inputs).what
    return Judged(name, what, figures=amounts, problems=problems, counts=fallbacks)


def _gap_rows(run: Run, horizon: str, *, informed: bool) -> dict[str, BoolArray]:
    """Return the rows with too small a gap by requirement."""
    trip, parameters = run.trajectory, run.parameters
    horizon_s = Horizon.parse(horizon).duration_s
    touching: BoolArray = trip.closest_m <= 0.0
    avoidable = avoidable_collisions(trip, parameters, horizon_s, informed=informed)
    rows = {"collision": avoidable, "collision_leader": touching & ~avoidable}
    below = below_s_min(trip, parameters)
    avoidable = np.zeros_like(touching)
    if informed:
        avoidable = avoidably_below_s_min(trip, parameters, horizon_s)
        rows["unsaid"] = _unforeseen(run, gap_margins_m(trip, parameters))
    return {**rows, "s_min": avoidable, "s_min_leader": below & ~avoidable}


def _judge_heat(run: Run, inputs: Any, amounts: dict[str, float], causes: dict[str, str]) -> None:
    trip = run.trajectory
    warmest_k = np.maximum(trip.cell_1_temperature_k, trip.cell_n_temperature_k)
    allowed_k = run.parameters.limits.max_temperature_k + OVERHEATED_BY_K
    hot = warmest_k > allowed_k
    amounts["too_hot"] = amounts["too_hot_anyway"] = 0.0
    if _longest_s(trip, hot) <= REQUIREMENTS["too_hot"].limit:
        return
    cooled_k = fully_cooled_k(trip, run.parameters, inputs.route, inputs.vehicle.integration_step_s)
    helped = hot & (cooled_k <= allowed_k)
    amounts["too_hot"] = _longest_s(trip, helped)
    amounts["too_hot_anyway"] = _longest_s(trip, hot & ~helped)
    highest = f"up to {warmest_k.max() - CELSIUS_ZERO_K:.1f} °C"
    best = f"{cooled_k[hot].max() - CELSIUS_ZERO_K:.1f} °C with full cooling"
    causes["too_hot"] = f"{highest}, {best}"


def _parting(here: Trajectory, there: Trajectory) -> str:
    """Return when two drives part, where one ends against the other, and how warm the cells were first."""
    parted = np.flatnonzero(np.abs(here.speed_m_s - there.speed_m_s) > PARTED_M_S)
    since = f"speeds part at {here.time_s[parted[0]]:g} s" if parted.size else "speeds never part"
    distance_m = float(here.position_m[-1] - there.position_m[-1])
    cells_c = float(here.cell_n_temperature_k[0]) - CELSIUS_ZERO_K
    return f"{since}, {distance_m:+.1f} m of way, cells first at {cells_c:.1f} °C"


def _longest_s(run: Trajectory, flags: BoolArray) -> float:
    return max(
        (float(run.time_s[last] - run.time_s[first]) for first, last in episodes(flags)),
        default=0.0,
    )


def fallback_text(rung: int, status: int) -> str:
    """Return rung and status of a fallback in words."""
    parts = (Rung(rung).name, SolveStatus(status).name)
    return " after ".join(part.lower().replace("_", " ") for part in parts)


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{count} x {text}" for text, count in counts.most_common())


def _fallbacks(run: Run, faults: Iterable[Fault]) -> tuple[Counter[str], int]:
    """Return the ticks on a fallback that no fault explains, in words, and the emergencies.

    Emergencies always count: a leader that brakes is none of the controller's faults.
    """
    rung, status = run.decisions.rung, run.decisions.status
    emergencies = int(np.count_nonzero(rung == Rung.EMERGENCY_BRAKING))
    explained = _explained_by_faults(run.trajectory, run.decisions.time_s, faults)
    rows = (rung != Rung.OPTIMAL) & (rung != Rung.EMERGENCY_BRAKING) & ~explained
    pairs = list(zip(rung[rows].tolist(), status[rows].tolist(), strict=True))
    rungs = list(dict.fromkeys(rung for rung, _ in pairs))
    pairs.sort(key=lambda pair: rungs.index(pair[0]))
    return Counter(fallback_text(*pair) for pair in pairs), emergencies


def _explained_by_faults(
    trip: Trajectory, times_s: FloatArray, faults: Iterable[Fault]
) -> BoolArray:
    """Return which instants lie in a fault, or so soon after it that the car may still recover."""
    explained: BoolArray = np.zeros(times_s.size, dtype=bool)
    for fault in faults:
        until_s = fault.end_s + RECOVERY_TICKS * float(trip.intervals_s[0])
        explained |= (fault.start_s <= times_s) & (times_s <= until_s)
    return explained


def _unforeseen(run: Run, margins_m: FloatArray) -> BoolArray:
    """Return the rows below s_min that the plan of the tick before did not foresee."""
    rows: BoolArray = np.zeros(margins_m.size, dtype=bool)
    if len(run.decisions):
        optimal = run.decisions.rung == Rung.OPTIMAL
        no_slack = optimal & (run.decisions.gap_slack_m < SLACK_M)
        rows[1:] = no_slack & (margins_m[1:] < -UNFORESEEN_M)
    return rows


def _circumstances(run: Run, rows: BoolArray) -> str:
    """Return when rows begin, how warm the cells were in them, and how they were decided."""
    trip = run.trajectory
    warmest_k = np.maximum(trip.cell_1_temperature_k, trip.cell_n_temperature_k)[rows]
    parts = [
        f"from {trip.time_s[rows][0]:g} s",
        f"cells at {warmest_k.min() - CELSIUS_ZERO_K:.0f} to {warmest_k.max() - CELSIUS_ZERO_K:.0f} °C",
    ]
    if len(run.decisions):
        # The decision of a row's interval was taken in the row before.
        rung, status = run.decisions.rung[rows[1:]], run.decisions.status[rows[1:]]
        pairs = zip(rung.tolist(), status.tolist(), strict=True)
        decided = Counter(fallback_text(*pair) for pair in pairs)
        parts += [_counted(decided)] if decided else []
    return ", ".join(parts)

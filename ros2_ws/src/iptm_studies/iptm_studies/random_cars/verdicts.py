"""What must hold in every run of a campaign, how it is measured, and why it did not hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from iptm_controller.horizon import Horizon
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.metrics import cold_compressor_energies_j, gap_margins_m
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_faults.fault import Fault
from iptm_studies.bounds import (
    BoolArray,
    avoidable_collisions,
    avoidably_below_s_min,
    below_s_min,
    episodes,
    fully_cooled_k,
)
from iptm_studies.run import Run
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import PreviewSpec

OVERHEATED_BY_K = 0.5
OVERHEATED_FOR_S = 60.0
PARTED_M_S = 0.3
"""Difference of two speeds from which on they are different drives."""
COLD_COMPRESSOR_KJ = 1.0
COLD_TRACTION_PERCENT = 3.0
SMALL_TRIP_J = 1e5
UNFORESEEN_M = 0.1
SLACK_M = 0.01
RECOVERY_TICKS = 5

Fallback = tuple[Rung, SolveStatus]


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
    limit: float = 0.0


REQUIREMENTS: Mapping[str, Requirement] = {
    "collision": Requirement(
        "Collision, avoidable",
        "rows of episodes with a gap of 0 or less that full deceleration within the jerk limit would have "
        "avoided: from a row at most a horizon back; where preview or measurements were not perfect, from "
        "the row in which the leader was first seen to lose its speed, or to be another car",
        "rows",
    ),
    "collision_leader": Requirement(
        "Collision, not avoidable", "the other rows with a gap of 0 or less", "rows", np.inf
    ),
    "s_min": Requirement(
        "Gap below s_min, avoidable",
        "perfect preview and measurements: rows of episodes below s_min (by over 1 cm) that braking alone "
        "would have avoided: from the state "
        "in one of the rows before, at most a horizon back, full deceleration within the jerk limit, the "
        "leader as it drove",
        "rows",
    ),
    "s_min_leader": Requirement(
        "Gap below s_min, not avoidable",
        "the other rows below s_min; those with which a trip begins do not count",
        "rows",
        np.inf,
    ),
    "hard": Requirement(
        "Hard limit broken", "rows beyond bounds or rates of acceleration and compressor", "rows"
    ),
    "cold_compressor": Requirement(
        "Compressor in the cold",
        "energy of the compressor in intervals that begin with both cells below T_b,min, "
        f"later than {RECOVERY_TICKS} ticks after each fault, as some falsify the cell temperatures",
        "kJ",
        COLD_COMPRESSOR_KJ,
    ),
    "cold_traction": Requirement(
        "Traction energy in the cold",
        "default strategy, air or cells first below T_b,min: excess over the same trip of the same car "
        "at 35 °C without temperature limits",
        "%",
        COLD_TRACTION_PERCENT,
    ),
    "unsaid": Requirement(
        "Gap below s_min, unforeseen",
        f"perfect preview and measurements: rows below s_min by over {UNFORESEEN_M:g} m, though the plan of "
        "the tick before had no slack",
        "rows",
    ),
    "fallback": Requirement(
        "Fallback",
        "ticks whose command is not that of a fresh solution, "
        f"later than {RECOVERY_TICKS} ticks after each fault",
        "ticks",
    ),
    "emergency": Requirement(
        "Emergency braking", "ticks with full braking against a collision ahead", "ticks", np.inf
    ),
    "too_hot": Requirement(
        "Cell too hot, avoidable",
        f"longest time in a row with a cell over {OVERHEATED_BY_K:g} K above T_b,max where the compressor at "
        "its most useful power from the start on would have kept it below that",
        "s",
        OVERHEATED_FOR_S,
    ),
    "too_hot_anyway": Requirement(
        "Cell too hot, not avoidable",
        f"longest time in a row with a cell over {OVERHEATED_BY_K:g} K above T_b,max, with full cooling, too",
        "s",
        np.inf,
    ),
}
"""What is judged, by key, in the order of the table."""


@dataclass(frozen=True)
class Judgement:
    """What was found in one run.

    Attributes:
        amounts: amount by key of the verdict; without those that do not apply.
        causes: why, for amounts above zero.
        ticks: decisions of the run.
        fallbacks: fallback ticks by rung and status of the solve.
    """

    amounts: Mapping[str, float]
    causes: Mapping[str, str]
    ticks: int
    fallbacks: Counter[Fallback] = field(default_factory=Counter)

    @property
    def breaches(self) -> tuple[str, ...]:
        """Keys of the verdicts that did not hold."""
        return tuple(
            key for key, amount in self.amounts.items() if amount > REQUIREMENTS[key].limit
        )


def judge(run: Run, inputs: RunInputs, warm_twin: Run | None = None) -> Judgement:
    """Judge a run of a closed loop.

    Args:
        run: the run.
        inputs: what it was made from.
        warm_twin: the same trip on a hot day without temperature limits, None if there is none.
    """
    trip, parameters = run.trajectory, run.parameters
    amounts: dict[str, float] = {}
    causes: dict[str, str] = {}

    margins_m = gap_margins_m(trip, parameters)

    def note_rows(key: str, rows: BoolArray) -> None:
        amounts[key] = float(np.count_nonzero(rows))
        if rows.any():
            causes[key] = (
                f"{-margins_m[rows].min():.1f} m below s_min, gap {trip.gap_m[rows].min():.1f} m, "
                + _circumstances(run, rows)
            )

    spec = inputs.spec
    informed = not spec.faults and spec.preview == PreviewSpec()
    horizon_s = Horizon.parse(spec.horizon).duration_s
    touching: BoolArray = trip.closest_m <= 0.0
    avoidable = avoidable_collisions(trip, parameters, horizon_s, informed=informed)
    note_rows("collision", avoidable)
    note_rows("collision_leader", touching & ~avoidable)
    avoidable = np.zeros_like(touching)
    if informed:
        avoidable = avoidably_below_s_min(trip, parameters, horizon_s)
        note_rows("unsaid", _unforeseen(run, margins_m))
    note_rows("s_min", avoidable)
    note_rows("s_min_leader", below_s_min(trip, parameters) & ~avoidable)

    broken = [check for check in run.metrics.constraints if check.hard and check.key != "collision"]
    amounts["hard"] = float(sum(check.violations for check in broken))
    causes["hard"] = ", ".join(
        f"{check.label} by {check.worst_excess:.3g} {check.unit} at {check.worst_time_s:g} s"
        for check in broken
        if check.violations
    )

    unexplained = ~_explained_by_faults(trip, trip.time_s, spec.faults)
    energy_j = cold_compressor_energies_j(trip, parameters) * unexplained
    amounts["cold_compressor"] = 1e-3 * float(energy_j.sum())
    if amounts["cold_compressor"] > COLD_COMPRESSOR_KJ:
        running = energy_j > 1.0
        causes["cold_compressor"] = (
            f"up to {trip.compressor_power_w[running].max():.0f} W, " + _circumstances(run, running)
        )

    if warm_twin is not None:
        here_j, there_j = (one.metrics.energy.traction_j for one in (run, warm_twin))
        amounts["cold_traction"] = 100.0 * (here_j - there_j) / max(abs(there_j), SMALL_TRIP_J)
        causes["cold_traction"] = (
            f"{1e-3 * here_j:.0f} kJ instead of {1e-3 * there_j:.0f} kJ, "
            + _parting(trip, warm_twin.trajectory)
        )

    rungs = _rungs_after_faults(run, spec.faults)
    amounts["emergency"] = float(rungs.pop(Rung.EMERGENCY_BRAKING, Counter()).total())
    fallbacks: Counter[Fallback] = sum(rungs.values(), Counter())
    amounts["fallback"] = float(fallbacks.total())
    causes["fallback"] = ", ".join(
        f"{count} x {fallback_text(cause)}" for cause, count in fallbacks.most_common()
    )
    _judge_heat(run, inputs, amounts, causes)
    return Judgement(amounts, causes, run.ticks, fallbacks)


def fallback_text(cause: Fallback) -> str:
    """Return rung and status of a fallback in words."""
    return " after ".join(part.name.lower().replace("_", " ") for part in cause)


def _judge_heat(
    run: Run,
    inputs: RunInputs,
    amounts: dict[str, float],
    causes: dict[str, str],
) -> None:
    trip = run.trajectory
    warmest_k = np.maximum(trip.cell_1_temperature_k, trip.cell_n_temperature_k)
    allowed_k = run.parameters.limits.max_temperature_k + OVERHEATED_BY_K
    hot = warmest_k > allowed_k
    amounts["too_hot"] = amounts["too_hot_anyway"] = 0.0
    if _longest_s(run.trajectory, hot) <= OVERHEATED_FOR_S:
        return
    cooled_k = fully_cooled_k(
        run.trajectory, run.parameters, inputs.route, inputs.spec.plant_step_s
    )
    helped = hot & (cooled_k <= allowed_k)
    amounts["too_hot"] = _longest_s(run.trajectory, helped)
    amounts["too_hot_anyway"] = _longest_s(run.trajectory, hot & ~helped)
    highest = f"up to {warmest_k.max() - CELSIUS_ZERO_K:.1f} °C"
    best = f"{cooled_k[hot].max() - CELSIUS_ZERO_K:.1f} °C with full cooling"
    causes["too_hot"] = causes["too_hot_anyway"] = f"{highest}, {best}"


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


def _rungs_after_faults(run: Run, faults: Iterable[Fault]) -> dict[Rung, Counter[Fallback]]:
    """Return the ticks that were not optimal by rung, without those that a fault explains.

    Emergencies always count: a leader that brakes is none of the controller's faults.
    """
    found: dict[Rung, Counter[Fallback]] = {}
    if run.decisions is None:
        return found
    decisions = run.decisions
    explained = _explained_by_faults(run.trajectory, decisions.time_s, faults)
    ticks = zip(decisions.rung.tolist(), decisions.status.tolist(), explained.tolist(), strict=True)
    for number, status, is_explained in ticks:
        rung = Rung(number)
        if rung is not Rung.OPTIMAL and (rung is Rung.EMERGENCY_BRAKING or not is_explained):
            found.setdefault(rung, Counter())[rung, SolveStatus(status)] += 1
    return found


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
    """Return the rows below s_min of which the plan of the tick before knew nothing."""
    rows: BoolArray = np.zeros(margins_m.size, dtype=bool)
    if run.decisions is not None:
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
    if run.decisions is not None:
        # The decision of a row's interval was taken in the row before.
        deciding = rows[1:]
        outcomes = Counter(
            (Rung(rung), SolveStatus(status))
            for rung, status in zip(
                run.decisions.rung[deciding].tolist(),
                run.decisions.status[deciding].tolist(),
                strict=True,
            )
        )
        parts += [f"{count} x {fallback_text(cause)}" for cause, count in outcomes.most_common()]
    return ", ".join(parts)

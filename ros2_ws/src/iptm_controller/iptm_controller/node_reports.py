"""Reports of the node on a decision: plan with node times, one short situation, and what lasts too long.

The latter is for the operator: broken limits, futile cooling, plans out of limits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from iptm_controller.actuation import WEAK_SHARE
from iptm_controller.decision import Decision
from iptm_controller.forecast import PreviewQuality
from iptm_controller.measurements import Measurements, trusted_measurements
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import Plan
from iptm_controller.safeguards import EMERGENCY
from iptm_controller.settings import WarningSettings
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.metrics.constraints import (
    GAP_TOLERANCE_M,
    SPEED_TOLERANCE_M_S,
    TEMPERATURE_TOLERANCE_K,
    Concern,
    IneffectiveCooling,
    Situation,
    Streak,
    broken_limits,
    cooling_at_limit,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import LeaderState, VehicleState
from iptm_ros.codecs import PlanTrajectory
from iptm_ros.diagnostics import Level

_RUNG_SITUATION = {
    Rung.SHIFTED_PLAN: (Level.WARN, "no usable solution, driving on the last plan"),
    Rung.SAFE_LAW: (Level.ERROR, "no usable solution, safe car-following law and thermostat"),
    Rung.STOP: (Level.ERROR, "controlled stop"),
    Rung.EMERGENCY_BRAKING: (Level.ERROR, EMERGENCY),
}
TOUCHING = "the leader is measured at no distance"
WEAK_BRAKES = "brakes deliver less than commanded"
RULE_BASED = "cruise control and thermostat"
LATE_COMMANDS = "commands act late, compensated"
ANOTHER_TRIP = "another trip has begun"
_PREVIEW_SITUATION = {
    PreviewQuality.SHORT: (Level.OK, "preview ends inside the horizon"),
    PreviewQuality.STALE: (Level.WARN, "preview too old, leader extrapolated"),
    PreviewQuality.MISSING: (Level.WARN, "no preview, leader extrapolated"),
    PreviewQuality.INVALID: (
        Level.WARN,
        "preview malformed or contradicted, leader extrapolated",
    ),
    PreviewQuality.DOUBTED: (Level.WARN, "previews were wrong and are trusted less far ahead"),
}

BREAKS = "plans break limits of "
LIMITS = ("gap", "speed", "temperature")
_TOLERANCES = (GAP_TOLERANCE_M, SPEED_TOLERANCE_M_S, TEMPERATURE_TOLERANCE_K)


def plan_trajectory(plan: Plan | None) -> PlanTrajectory:
    """Return the plan as published: inputs hold from their node on, the last node repeats the last ones.

    It ends with the motion, as thermal steps have no position. None becomes a plan without
    nodes, as subscribers may wait for the plan of a tick.
    """
    if plan is None:
        return PlanTrajectory(*np.empty((7, 0)))
    steps = plan.motion_steps
    inputs = np.vstack([plan.inputs[:steps], plan.inputs[steps - 1]])
    states = plan.states[: steps + 1]
    times_s, positions_m, speeds_m_s = plan.motion
    return PlanTrajectory(
        times_s=times_s,
        positions_m=positions_m,
        speeds_m_s=speeds_m_s,
        cell_1_temperatures_k=states[:, StateIndex.CELL_1_TEMPERATURE],
        cell_n_temperatures_k=states[:, StateIndex.CELL_N_TEMPERATURE],
        accelerations_m_s2=inputs[:, InputIndex.ACCELERATION],
        compressor_powers_w=inputs[:, InputIndex.COMPRESSOR_POWER],
    )


def road_warning(fault: str, *, is_known: bool) -> str:
    """Return what the controller drives on instead of a good new slope, empty if there is one.

    Args:
        fault: of the newest slope, empty for none.
        is_known: whether a usable one has been received.
    """
    if fault:
        taken = "the last good one is used" if is_known else "road taken as flat"
        return f"slope message malformed, {taken}"
    return "" if is_known else "no slope received, road taken as flat"


def situation(
    decision: Decision | None,
    road: str,
    watch: OperatorWatch | None = None,
    *,
    begun_anew: bool = False,
) -> tuple[Level, str]:
    """Return severity and one short sentence without numbers, for the diagnostics.

    Args:
        decision: None before the first.
        road: see `road_warning`.
        watch: what has gone on for too long, added to the situation of the decision.
        begun_anew: whether another trip has just taken the place of the one so far.
    """
    level, reason = _of_trip(decision, road, watch)
    if not begun_anew:
        return level, reason
    return (Level.WARN, ANOTHER_TRIP) if level is Level.OK else (level, f"{ANOTHER_TRIP}, {reason}")


def _of_trip(
    decision: Decision | None, road: str, watch: OperatorWatch | None
) -> tuple[Level, str]:
    level, reason = _of_decision(decision, road)
    if watch is None or decision is None:
        return level, reason
    if watch.in_contact:
        return Level.ERROR, ", ".join((TOUCHING, *watch.warnings))
    if not watch.warnings:
        return level, f"{reason}, {watch.note}" if level is Level.OK and watch.note else reason
    if level is Level.OK:
        return Level.WARN, ", ".join(watch.warnings)
    return level, ", ".join((reason, *watch.warnings))


def _of_decision(decision: Decision | None, road: str) -> tuple[Level, str]:
    if decision is None:
        return Level.WARN, "waiting for state, leader and preview"
    if decision.rung in _RUNG_SITUATION:
        return _RUNG_SITUATION[decision.rung]
    warnings = _warnings(decision)
    if warnings:
        return Level.WARN, warnings[0]
    forecast = decision.forecast
    if forecast is not None and forecast.quality in _PREVIEW_SITUATION:
        level, reason = _PREVIEW_SITUATION[forecast.quality]
        if level is not Level.OK or not road:
            return level, reason
    if road:
        return Level.WARN, road
    return Level.OK, "optimal plans" if decision.plan is not None else RULE_BASED


def _warnings(decision: Decision) -> list[str]:
    """Return the faults of vehicle and plan, the most important first."""
    broken, result = _limits_broken(decision), decision.result
    early = result is not None and result.status is SolveStatus.FEASIBLE
    pack = () if decision.pack is None else decision.pack.faults
    cases = (
        *((True, fault.value) for fault in pack),
        (decision.brake_share < WEAK_SHARE, WEAK_BRAKES),
        (decision.command_delay_s > 0.0, LATE_COMMANDS),
        (bool(broken), BREAKS + ", ".join(broken)),
        (early, "solver stopped early, feasible plan used"),
    )
    return [text for holds, text in cases if holds]


def _limits_broken(decision: Decision) -> tuple[str, ...]:
    """Return the soft limits that the plan breaks."""
    if decision.plan is None:
        return ()
    slacks = zip(LIMITS, decision.plan.slacks.values(), _TOLERANCES, strict=True)
    return tuple(name for name, slack, tolerance in slacks if slack > tolerance)


def decision_values(decision: Decision) -> dict[str, object]:
    """Return the key values of the diagnostics about a decision."""
    details: dict[str, object] = {
        "reason": decision.reason or "none",
        "rung": decision.rung.name.lower(),
        "limiter": ", ".join(decision.limits) or "inactive",
        "noise": decision.noise or "none",
        "command_delay_s": decision.command_delay_s,
        "brake_share": decision.brake_share,
    }
    result, forecast = decision.result, decision.forecast
    if result is not None:
        details.update(
            status=result.status.name.lower(),
            solve_time_ms=1e3 * result.time_s,
            iterations=result.iterations,
        )
    if forecast is not None:
        details["preview"] = PreviewQuality(forecast.quality).name.lower()
        details["preview_age_s"] = forecast.age_s
        details["trusted_preview_s"] = forecast.known_s
    return details


class DecisionCounts:
    """How often the solver and the ladder came to which outcome, and how many commands were limited."""

    def __init__(self) -> None:
        self.limited = 0
        self._solves: Counter[SolveStatus] = Counter()
        self._rungs: Counter[Rung] = Counter()

    def add(self, decision: Decision) -> None:
        """Count a decision."""
        self._solves[decision.record.status] += 1
        self._rungs[decision.rung] += 1
        self.limited += bool(decision.limits)

    @property
    def values(self) -> dict[str, object]:
        """Key values for the diagnostics."""
        return {
            **{f"solves_{status.name.lower()}": self._solves[status] for status in SolveStatus},
            **{f"ticks_{rung.name.lower()}": self._rungs[rung] for rung in Rung},
        }


_WARNINGS = {
    Concern.SHORT_GAP: "gap below s_min for long",
    Concern.LONG_GAP: "gap above s_max for long",
    Concern.SPEED: "speed out of its limits for long",
    Concern.HOT_CELL: "cell above its highest temperature for long",
    Concern.COOLING: "compressor at its limit without effect",
    Concern.PLAN: "plans never get back within limits",
}
CONCERNS = frozenset(_WARNINGS.values())
"""All reasons to warn of something that has gone on for too long."""
COLD = "pack below its lowest temperature, which forbids cooling"


class OperatorWatch:
    """Follows the trip tick by tick.

    Attributes:
        lasted_s: for how long each concern has lasted now, in s.
        in_contact: whether the measured gap is zero or negative.
        note: informational note that is not a warning, empty for none.
    """

    def __init__(self, parameters: ModelParameters, settings: WarningSettings) -> None:
        self._parameters = parameters
        self._allowed_s = {concern: settings.after_s(concern) for concern in Concern}
        self._streaks = {concern: Streak() for concern in Concern}
        self._cooling = IneffectiveCooling()
        self.lasted_s: dict[Concern, float] = dict.fromkeys(Concern, 0.0)
        self.in_contact = False
        self.note = ""

    def update(self, measured: Measurements, decision: Decision) -> None:
        """Update with a tick; one without a plausible state or leader is ignored."""
        if decision.pack is not None and decision.pack.faults:
            measured = replace(measured, state=decision.pack.state)
        state, leader, _ = trusted_measurements(measured)
        if state is not None and leader is not None:
            self._watch_trip(state, leader)
            ends_outside = self._ends_outside(decision)
            if ends_outside is not None:
                self._count(Concern.PLAN, state.time_s, holds=ends_outside)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to warn, without numbers; empty if there is none."""
        return tuple(
            text
            for concern, text in _WARNINGS.items()
            if self.lasted_s[concern] > self._allowed_s[concern]
        )

    @property
    def values(self) -> Mapping[str, object]:
        """Times that the concerns have lasted, by the key of a diagnostic value."""
        return {f"{concern.value}_s": lasted for concern, lasted in self.lasted_s.items()}

    def _watch_trip(self, state: VehicleState, leader: LeaderState) -> None:
        at = Situation.at(state, leader)
        self.in_contact = bool(at.gap_m <= 0.0)
        for concern, broken in broken_limits(at, self._parameters).items():
            self._count(concern, state.time_s, holds=bool(broken))
        at_limit = bool(cooling_at_limit(at, self._parameters))
        self.lasted_s[Concern.COOLING] = self._cooling.update(
            state.time_s, at.warmest_cell_k, at_limit=at_limit
        )
        mean_k = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        lowest_k = self._parameters.limits.min_temperature_k - TEMPERATURE_TOLERANCE_K
        self.note = COLD if mean_k < lowest_k else ""

    def _count(self, concern: Concern, time_s: float, *, holds: bool) -> None:
        self.lasted_s[concern] = self._streaks[concern].update(time_s, holds=holds)

    def _ends_outside(self, decision: Decision) -> bool | None:
        """Return whether the last node of the plan breaks a watched limit, None without a plan."""
        plan, forecast = decision.plan, decision.forecast
        if plan is None or forecast is None:
            return None
        moving, last = plan.states[plan.motion_steps], plan.states[-1]
        end_s = plan.start_s + plan.node_times_s[plan.motion_steps]
        positions, speeds = forecast.motion.at(np.array([end_s]))
        end = Situation(
            gap_m=float(positions[0] - moving[StateIndex.POSITION]),
            speed_m_s=float(moving[StateIndex.SPEED]),
            leader_speed_m_s=float(speeds[0]),
            warmest_cell_k=float(
                max(last[StateIndex.CELL_1_TEMPERATURE], last[StateIndex.CELL_N_TEMPERATURE])
            ),
            compressor_power_w=float(last[StateIndex.LAST_COMPRESSOR_POWER]),
        )
        return any(bool(broken) for broken in broken_limits(end, self._parameters).values())

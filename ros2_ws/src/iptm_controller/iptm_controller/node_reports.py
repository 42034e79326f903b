"""What the node tells about a decision: plan with node times, one short situation."""

from __future__ import annotations

import numpy as np

from iptm_controller.collision_guard import EMERGENCY
from iptm_controller.controller import Decision
from iptm_controller.forecast import PreviewQuality
from iptm_controller.node_watch import OperatorWatch
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import Plan
from iptm_core.decision_record import Rung, SolveStatus
from iptm_interfaces.codecs import PlanTrajectory
from iptm_interfaces.diagnostics import Level

_RUNG_SITUATION = {
    Rung.SHIFTED_PLAN: (Level.WARN, "no usable solution, driving on the last plan"),
    Rung.SAFE_LAW: (Level.ERROR, "no usable solution, safe car-following law and thermostat"),
    Rung.STOP: (Level.ERROR, "controlled stop"),
    Rung.EMERGENCY_BRAKING: (Level.ERROR, EMERGENCY),
}
_PREVIEW_SITUATION = {
    PreviewQuality.SHORT: (Level.OK, "preview ends inside the horizon"),
    PreviewQuality.STALE: (Level.WARN, "preview too old, leader taken at constant speed"),
    PreviewQuality.MISSING: (Level.WARN, "no preview, leader taken at constant speed"),
    PreviewQuality.INVALID: (
        Level.WARN,
        "preview malformed or contradicted, leader taken at constant speed",
    ),
}


def plan_trajectory(plan: Plan) -> PlanTrajectory:
    """Return the plan as published: inputs hold from their node on, the last node repeats the last ones.

    It ends with the motion: of thermal steps there is no position to publish.
    """
    steps = plan.motion_steps
    inputs = np.vstack([plan.inputs[:steps], plan.inputs[steps - 1]])
    states = plan.states[: steps + 1]
    return PlanTrajectory(
        times_s=plan.start_s + plan.node_times_s[: steps + 1],
        positions_m=states[:, StateIndex.POSITION],
        speeds_m_s=states[:, StateIndex.SPEED],
        cell_1_temperatures_k=states[:, StateIndex.CELL_1_TEMPERATURE],
        cell_n_temperatures_k=states[:, StateIndex.CELL_N_TEMPERATURE],
        accelerations_m_s2=inputs[:, InputIndex.ACCELERATION],
        compressor_powers_w=inputs[:, InputIndex.COMPRESSOR_POWER],
    )


def situation(
    decision: Decision | None,
    *,
    road_known: bool,
    road_fault: str,
    watch: OperatorWatch | None = None,
) -> tuple[Level, str]:
    """Return severity and one short sentence without numbers, for the diagnostics.

    Args:
        decision: the last one, None before the first.
        road_known: a slope has been received.
        road_fault: what is wrong with it, empty if nothing.
        watch: what has gone on for too long, added to the situation of the decision.
    """
    level, reason = _of_decision(decision, road_known=road_known, road_fault=road_fault)
    if watch is None or decision is None:
        return level, reason
    if not watch.warnings:
        return level, f"{reason}, {watch.note}" if level is Level.OK and watch.note else reason
    if level is Level.OK:
        return Level.WARN, ", ".join(watch.warnings)
    return level, ", ".join((reason, *watch.warnings))


def _of_decision(
    decision: Decision | None, *, road_known: bool, road_fault: str
) -> tuple[Level, str]:
    if decision is None:
        return Level.OK, "waiting for state, leader and preview"
    if decision.rung in _RUNG_SITUATION:
        return _RUNG_SITUATION[decision.rung]
    result, forecast = decision.result, decision.forecast
    if result is not None and result.status is SolveStatus.FEASIBLE:
        return Level.WARN, "solver stopped early, feasible plan used"
    if forecast is not None and forecast.quality in _PREVIEW_SITUATION:
        return _PREVIEW_SITUATION[forecast.quality]
    if road_fault:
        return Level.WARN, "slope message malformed, road taken as flat"
    if not road_known:
        return Level.WARN, "no slope received, road taken as flat"
    return Level.OK, "optimal plans"

"""What the node tells about a decision: report, plan with node times, one short situation."""

from __future__ import annotations

import math

import numpy as np

from iptm_controller.controller import Decision
from iptm_controller.forecast import PreviewQuality
from iptm_controller.ladder import Rung
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import Plan
from iptm_controller.solvers.result import SolveStatus
from iptm_interfaces.codecs import PlanTrajectory, SolveReport
from iptm_interfaces.diagnostics import Level

NO_SOLVE = -1
"""Status code of a tick at which no problem could be posed."""

_RUNG_SITUATION = {
    Rung.SHIFTED_PLAN: (Level.WARN, "no usable solution, driving on the last plan"),
    Rung.SAFE_LAW: (Level.ERROR, "no usable solution, safe car-following law and thermostat"),
    Rung.STOP: (Level.ERROR, "controlled stop"),
}
_PREVIEW_SITUATION = {
    PreviewQuality.SHORT: (Level.OK, "preview ends inside the horizon"),
    PreviewQuality.STALE: (Level.WARN, "preview too old, leader taken at constant speed"),
    PreviewQuality.MISSING: (Level.WARN, "no preview, leader taken at constant speed"),
    PreviewQuality.INVALID: (Level.WARN, "preview malformed, leader taken at constant speed"),
}


def solve_report(decision: Decision) -> SolveReport:
    """The report that is published with a decision; what is not known is NaN."""
    result, plan, forecast = decision.result, decision.plan, decision.forecast
    slacks = None if plan is None else plan.slacks
    return SolveReport(
        status_code=NO_SOLVE if result is None else int(result.status),
        solve_time_s=math.nan if result is None else result.time_s,
        iterations=0 if result is None else result.iterations,
        gap_slack_m=math.nan if slacks is None else slacks.gap_m,
        speed_slack_m_s=math.nan if slacks is None else slacks.speed_m_s,
        temperature_slack_k=math.nan if slacks is None else slacks.temperature_k,
        objective=math.nan if result is None else result.objective,
        fallback_rung=int(decision.rung),
        limiter_active=decision.limited.active,
        preview_age_s=math.nan if forecast is None else forecast.age_s,
    )


def plan_trajectory(plan: Plan) -> PlanTrajectory:
    """The plan as published: inputs hold from their node on, the last node repeats the last ones."""
    inputs = np.vstack([plan.inputs, plan.inputs[-1]])
    states = plan.states
    return PlanTrajectory(
        times_s=plan.start_s + plan.node_times_s,
        positions_m=states[:, StateIndex.POSITION],
        speeds_m_s=states[:, StateIndex.SPEED],
        cell_1_temperatures_k=states[:, StateIndex.CELL_1_TEMPERATURE],
        cell_n_temperatures_k=states[:, StateIndex.CELL_N_TEMPERATURE],
        accelerations_m_s2=inputs[:, InputIndex.ACCELERATION],
        compressor_powers_w=inputs[:, InputIndex.COMPRESSOR_POWER],
    )


def situation(decision: Decision | None, *, road_known: bool, road_fault: str) -> tuple[Level, str]:
    """Severity and one short sentence without numbers, for the diagnostics."""
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

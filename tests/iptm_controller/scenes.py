"""Scenes, problems and solvers for the tests of the controller; each solver is built once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from studies.speed.transcription import Transcription, transcribe
from tests.iptm_controller.ipopt_backend import IPOPT, IpoptBackend
from tests.reference.switching_check import SwitchingCheckInPython

from iptm_controller.forecast import LeaderForecaster
from iptm_controller.horizon import Horizon
from iptm_controller.lead_check import ACCELERATION_DECAY_S
from iptm_controller.measurements import Measurements
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import UNBOUNDED_W, ProblemData, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid, quadrature, sample_count
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.ocp.stages import build_stage
from iptm_controller.plan import PlanShifter, sample_positions_m, variables_from_plan
from iptm_controller.solvers.factory import build_plain_solver, build_solver
from iptm_controller.solvers.interface import (
    STATUS_TEXT,
    SolverBackend,
    SolveResult,
    SolverOptions,
)
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import COST_TERMS, REFERENCE_TEMPERATURE_K, strategy_by_name
from iptm_controller.tick_library import tick_library
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.power_thermal import (
    CellPair,
    PowerThermalRates,
    Smoothing,
    power_thermal_rates,
)
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, SlopePreview, VehicleState

PARAMETERS = load_parameters().values
Problem = tuple[ProblemData, FloatArray]
"""Numbers of a problem, and a guess."""
FLAT = SlopePreview(np.zeros(1), np.zeros(1))
NOW_S = 100.0
HERE_M = 1000.0
MAX_AGE_S = 10.0
"""Of a preview that is used."""


def make_state(**changes: float) -> VehicleState:
    """An ego vehicle in the middle of a trip, with some values changed."""
    state = VehicleState(
        time_s=NOW_S,
        position_m=HERE_M,
        speed_m_s=15.0,
        acceleration_m_s2=0.0,
        compressor_power_w=0.0,
        cell_1_temperature_k=307.15,
        cell_n_temperature_k=308.15,
        cell_1_capacity_loss=1e-3,
        cell_n_capacity_loss=1e-3,
    )
    return replace(state, **changes)


def make_leader(
    gap_m: float = 40.0, speed_m_s: float = 15.0, time_s: float = NOW_S, ego_m: float = HERE_M
) -> LeaderState:
    return LeaderState(time_s, ego_m + gap_m, speed_m_s)


def make_preview(
    leader: LeaderState,
    acceleration_m_s2: float = 0.0,
    length_s: float = 60.0,
    target_m_s: float | None = None,
) -> LeaderPreview:
    """What a leader predicts that accelerates evenly, down to standstill or up to a target speed."""
    ahead = np.arange(0.0, length_s + 0.5)
    low, high = 0.0, 40.0
    if target_m_s is not None:
        low, high = min(target_m_s, leader.speed_m_s), max(target_m_s, leader.speed_m_s)
    speeds = np.clip(leader.speed_m_s + acceleration_m_s2 * ahead, low, high)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    times = leader.time_s + ahead
    return LeaderPreview(times, leader.position_m + moved, speeds)


def make_scene(
    *,
    gap_m: float = 40.0,
    leader_speed_m_s: float = 15.0,
    leader_acceleration_m_s2: float = 0.0,
    slope: SlopePreview = FLAT,
    **state: float,
) -> Measurements:
    """One tick's measurements, everything measured and consistent."""
    ego = make_state(**state)
    leader = make_leader(gap_m, leader_speed_m_s, ego.time_s, ego.position_m)
    return Measurements(ego, leader, make_preview(leader, leader_acceleration_m_s2), slope)


def hills(amplitude: float = 0.06) -> SlopePreview:
    """Waves in the road around where the ego vehicle is."""
    positions = np.arange(0.0, 4000.0, 10.0)
    return SlopePreview(positions, amplitude * np.sin(positions / 90.0))


SCENES: dict[str, Measurements] = {
    "cruise": make_scene(),
    "hills": make_scene(slope=hills(), speed_m_s=20.0, leader_speed_m_s=21.0, gap_m=60.0),
    "leader_brakes": make_scene(leader_acceleration_m_s2=-1.5, gap_m=45.0),
    "leader_pulls_away": make_scene(
        speed_m_s=2.0, leader_speed_m_s=3.0, leader_acceleration_m_s2=1.5, gap_m=12.0
    ),
    "standstill": make_scene(speed_m_s=0.0, leader_speed_m_s=0.0, gap_m=15.0),
    "cooling": make_scene(
        compressor_power_w=900.0, cell_1_temperature_k=309.0, cell_n_temperature_k=311.0
    ),
    "fast": make_scene(
        speed_m_s=33.0, leader_speed_m_s=34.0, gap_m=90.0, acceleration_m_s2=0.4, slope=hills(0.02)
    ),
}
"""Ordinary situations; what is out of the ordinary is built in the test that needs it."""


def make_forecaster(
    horizon_s: float = 28.0, max_age_s: float = MAX_AGE_S, tick_s: float = 1.0
) -> LeaderForecaster:
    """Return a forecaster that has not measured a leader, over the default horizon."""
    decays_s = ACCELERATION_DECAY_S, ACCELERATION_DECAY_S
    return LeaderForecaster(tick_library(), horizon_s, max_age_s, tick_s, *decays_s)


def problem_of(
    measured: Measurements, horizon: str = "3x1+5x5", strategy: str = "aging"
) -> Problem:
    """Pose the problem of a scene on a horizon: its data and a cold guess."""
    grid = ProblemGrid(Horizon.parse(horizon))
    builder = ProblemDataBuilder(grid, strategy_by_name(strategy), PARAMETERS)
    guess = PlanShifter(grid.horizon).cold_start(measured.state)
    forecaster = make_forecaster(grid.horizon.duration_s)
    motion = forecaster.forecast(measured.leader, measured.preview).motion
    expected = sample_positions_m(guess, grid.sample_times_s)
    data = builder.build(measured.state, motion, measured.slope, expected)
    return data, variables_from_plan(guess, grid, measured.state)


@lru_cache
def plain_solver(horizon: str = "3x1+5x5", name: str = "riccati") -> SolverBackend:
    """Return a solver without the check of the switching."""
    return solver_with(horizon, SolverOptions(), name)


def solver_with(horizon: str, options: SolverOptions, name: str = "riccati") -> SolverBackend:
    """Return the solver, or IPOPT as the reference, with options."""
    if name == IPOPT:
        return IpoptBackend(OptimalControlProblem(Horizon.parse(horizon), PARAMETERS), options)
    return build_plain_solver(Horizon.parse(horizon), PARAMETERS, options)


@lru_cache
def checking_solver(horizon: str = "3x1+5x5") -> SwitchingCheck:
    """Return a solver as the controller uses it."""
    return build_solver(Horizon.parse(horizon), PARAMETERS, SolverOptions())


def check_in_python(
    inner: SolverBackend, horizon: str = "3x1+5x5", **numbers: Any
) -> SwitchingCheckInPython:
    """Return the check that wraps any solver."""
    problem = OptimalControlProblem(Horizon.parse(horizon), PARAMETERS)
    return SwitchingCheckInPython(inner, problem, replace(checking_solver().numbers, **numbers))


@lru_cache
def transcription_of(horizon: str) -> Transcription:
    return transcribe(OptimalControlProblem(Horizon.parse(horizon), PARAMETERS))


@lru_cache
def _stage_function(
    step_s: float, samples: int, smoothing: Smoothing, model: ModelParameters
) -> ca.Function:
    stage = build_stage(step_s, samples, SymbolicModel.literal(model), smoothing)
    inputs = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
    return ca.Function("stage", inputs, [stage.next_state, stage.cost, stage.limits])


def run_stage(
    state: VehicleState,
    acceleration_m_s2: float,
    compressor_power_w: float,
    step_s: float,
    weights: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    *,
    slacks: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    leader: tuple[float, float] = (0.0, 0.0),
    speed_reference_m_s: float = 0.0,
    slope: Callable[[float], tuple[float, float, float]] = lambda _: (0.0, 0.0, 0.0),
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    samples: int | None = None,
    end_of_horizon: bool = False,
    prices: tuple[float, float, float] = (0.0, 0.0, 0.0),
    lowest_k: float = 0.0,
    thermal_energy_price_1_j: float = 0.0,
    headway_price_1_m2_s: float = 0.0,
    model: ModelParameters = PARAMETERS,
    max_speed_m_s: float | None = None,
    charge_w: float = UNBOUNDED_W,
) -> tuple[FloatArray, float, FloatArray]:
    """Return the result of one step of the optimal control problem, in physical units.

    Takes a state, acceleration and compressor power, the step and the weights of the first cost terms;
    returns the next state with an absolute position, the cost and the rows of the limits.
    """
    count = samples or sample_count(step_s)
    physical = np.array(
        [0.0, state.speed_m_s, state.cell_1_temperature_k, state.cell_n_temperature_k,
         state.acceleration_m_s2, state.compressor_power_w]
    )  # fmt: skip
    step_parameters = [
        leader[0] - state.position_m, leader[1], step_s, step_s, float(end_of_horizon),
        model.limits.max_speed_m_s if max_speed_m_s is None else max_speed_m_s,
    ]  # fmt: skip
    for node in quadrature(count)[0] * step_s:
        moved = state.speed_m_s * node + 0.5 * acceleration_m_s2 * node**2
        around = slope(state.position_m + moved)
        ahead = leader[0] - state.position_m - leader[1] * (step_s - node)
        step_parameters += [*around, moved, speed_reference_m_s, ahead, leader[1]]
    losses = [state.cell_1_capacity_loss, state.cell_n_capacity_loss]
    shared = [*losses, REFERENCE_TEMPERATURE_K, *prices, lowest_k, thermal_energy_price_1_j]
    shared += [charge_w, headway_price_1_m2_s, *weights]
    shared += [0.0] * (len(COST_TERMS) - len(weights))
    following, cost, limits = _stage_function(step_s, count, smoothing, model)(
        (physical - layout.STATE_OFFSET) / layout.STATE_SCALE,
        np.array([acceleration_m_s2, compressor_power_w, *slacks]) / layout.INPUT_SCALE,
        step_parameters,
        shared,
    )
    following = following.full().ravel() * layout.STATE_SCALE + layout.STATE_OFFSET
    following[0] += state.position_m
    return following, float(cost), limits.full().ravel()


def exact_rates(
    state: VehicleState, acceleration_m_s2: float = 0.0, power_w: float = 0.0
) -> PowerThermalRates:
    """Rates of a state on a flat road."""
    cells = CellPair(
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.cell_1_capacity_loss,
        state.cell_n_capacity_loss,
    )
    channel = reduce_channel(PARAMETERS.cooling, PARAMETERS.pack)
    return power_thermal_rates(
        state.speed_m_s, acceleration_m_s2, 0.0, power_w, cells, PARAMETERS, channel
    )


class FailingSolver:
    """Solves with an inner solver, or answers with a failure."""

    name = "failing"

    def __init__(
        self, inner: SolverBackend | None = None, failure: SolveStatus | None = None
    ) -> None:
        self._inner = inner
        self.failure = failure

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        del most_iterations
        if self.failure is None:
            return self._inner.solve(data, guess)
        nothing = np.full(guess.shape, np.nan)
        reason = STATUS_TEXT[self.failure]
        return SolveResult(self.failure, reason, nothing, math.nan, 0, 0.0, math.inf)


NONE_YET = LeaderPreview.empty()
"""No preview has arrived."""


def expect_constant_speed(motion: LeaderPreview, leader: LeaderState) -> None:
    times = leader.time_s + np.array([0.0, 1.0, 28.0])
    positions, speeds = motion.at(times)
    assert speeds.tolist() == [leader.speed_m_s] * 3
    np.testing.assert_allclose(
        positions, leader.position_m + leader.speed_m_s * (times - leader.time_s)
    )

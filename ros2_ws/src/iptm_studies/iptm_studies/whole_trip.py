"""The limit: a whole trip as one optimal control problem, everything about it known beforehand.

The same stages as in the controller, one step per tick from start to end, solved by the
structure-exploiting solver. The slope depends on the position; it is expanded to second order around the
last solution and the problem solved again until the positions settle. The inputs found are then driven
on the exact plant, so that the result is measured like every other run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iptm_controller.forecast import LeaderMotion
from iptm_controller.horizon import Horizon, HorizonPhase
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import REFERENCE_WINDOW_S, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import (
    Plan,
    Slacks,
    plan_from_variables,
    sample_positions_m,
    variables_from_plan,
)
from iptm_controller.solvers.factory import SolverOptions, build_plain_solver
from iptm_controller.solvers.interface import SolveResult
from iptm_controller.strategy import Strategy
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.route import Route
from iptm_core.state import Command, SlopePreview, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant

NEAR_BARRIER = 1e-2


@dataclass(frozen=True)
class WholeTripOptions:
    """Settings of the whole-trip solve.

    Attributes:
        tick_s: step length.
        tolerance: optimality tolerance of the scaled problem.
        max_iterations: iterations of one solve at most.
        max_expansions: solves with renewed slope expansion at most.
        settled_m: the expansion is settled when no position moves by more than this.
    """

    tick_s: float = 1.0
    tolerance: float = 1e-4
    max_iterations: int = 5000
    max_expansions: int = 12
    settled_m: float = 10.0


@dataclass(frozen=True)
class Expansion:
    """One solve with a slope expansion.

    Attributes:
        result: the solver's answer, without its variables.
        moved_m: largest change of a position against the expansion point.
    """

    result: SolveResult
    moved_m: float


@dataclass(frozen=True)
class WholeTripRun:
    """The optimum and what the plant makes of it.

    Attributes:
        trajectory: the plant driven with the optimal inputs.
        expansions: every solve, in order.
        slacks: largest violations of soft limits in the plan.
        objective: cost of the last plan.
    """

    trajectory: Trajectory
    expansions: tuple[Expansion, ...]
    slacks: Slacks
    objective: float

    @property
    def settled(self) -> bool:
        """True if the last solve converged."""
        return self.expansions[-1].result.status.usable


def solve_whole_trip(
    route: Route,
    parameters: ModelParameters,
    plant: Plant,
    strategy: Strategy,
    start: Trajectory,
    options: WholeTripOptions,
    on_expansion: Callable[[Expansion], None] | None = None,
) -> WholeTripRun:
    """Optimise a whole trip.

    Args:
        route: leader and slope, all known.
        parameters: vehicle, limits.
        plant: the vehicle that the optimum is driven on.
        strategy: cost terms and weights.
        start: a finished run of the same route, as first guess.
        options: settings.
        on_expansion: called after every solve.

    Raises:
        SolverSetupError: the problem cannot be built.
    """
    steps = round(route.duration_s / options.tick_s)
    horizon = Horizon((HorizonPhase(steps, options.tick_s),))
    # What was driven is far from the optimum of the trip, what was found for another expansion is near.
    first, further = (
        build_plain_solver(
            horizon,
            parameters,
            SolverOptions(
                max_iterations=options.max_iterations,
                tolerance=options.tolerance,
                initial_barrier=NEAR_BARRIER,
                warm_start_iterations=warm_start,
            ),
        )
        for warm_start in (0, options.max_iterations)
    )
    grid = ProblemGrid(horizon)
    builder = ProblemDataBuilder(grid, strategy)
    leader = _leader_motion(route, horizon)
    slope = SlopePreview(np.asarray(route.slope.positions_m), np.asarray(route.slope.slopes_rad))
    state = plant.initial_state()
    plan = _plan_of(start, horizon)
    expansions: list[Expansion] = []
    objective = float("nan")
    for index in range(options.max_expansions):
        solver = further if index else first
        expected = sample_positions_m(plan, grid.sample_times_s)
        data = builder.build(state, leader, slope, expected)
        result = solver.solve(data, variables_from_plan(plan, grid, state))
        found = plan_from_variables(result.variables, grid, state)
        moved = np.abs(found.states[:, StateIndex.POSITION] - plan.states[:, StateIndex.POSITION])
        expansions.append(Expansion(result, float(moved.max())))
        if on_expansion is not None:
            on_expansion(expansions[-1])
        plan, objective = found, result.objective
        if result.status.usable and moved.max() <= options.settled_m:
            break
    trajectory = _drive(plan, route, plant, state, options.tick_s)
    return WholeTripRun(trajectory, tuple(expansions), plan.slacks, objective)


def _leader_motion(route: Route, horizon: Horizon) -> LeaderMotion:
    """The leader from before the start (speed references look back) to the end."""
    before = np.arange(-REFERENCE_WINDOW_S - 1.0, 0.0)
    times = np.concatenate([before, horizon.node_times_s])
    return LeaderMotion(times, route.leader.positions_at(times), route.leader.speeds_at(times))


def _plan_of(run: Trajectory, horizon: Horizon) -> Plan:
    """A finished run as a plan; its slacks start at zero."""
    states = np.column_stack(
        [
            run.position_m,
            run.speed_m_s,
            run.cell_1_temperature_k,
            run.cell_n_temperature_k,
            run.acceleration_m_s2,
            run.compressor_power_w,
        ]
    )
    inputs = np.zeros((horizon.steps, layout.INPUTS))
    inputs[:, InputIndex.ACCELERATION] = run.acceleration_m_s2[1:]
    inputs[:, InputIndex.COMPRESSOR_POWER] = run.compressor_power_w[1:]
    return Plan(0.0, horizon.node_times_s, states, inputs)


def _drive(
    plan: Plan, route: Route, plant: Plant, state: VehicleState, tick_s: float
) -> Trajectory:
    """Drive the plant with the plan's inputs, without feedback."""
    step = plant.observe(state)
    ticks = [(step, route.leader.state_at(step.state.time_s))]
    for row in plan.inputs:
        command = Command(
            float(row[InputIndex.ACCELERATION]), float(row[InputIndex.COMPRESSOR_POWER])
        )
        step = plant.advance(step.state, command, tick_s)
        ticks.append((step, route.leader.state_at(step.state.time_s)))
    return Trajectory.from_ticks(ticks)

"""The upper bound: a whole trip as one optimal control problem, with perfect knowledge of it.

The same stages as in the controller, one step per tick from start to end, solved by the
structure-exploiting solver. The slope depends on the position; it is expanded to second order around the
last solution and the problem solved again until the positions settle. The inputs found are then driven
on the exact plant, so that the result is measured like every other run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypedDict

import numpy as np

from iptm.driving import drive_in_memory, plant_for
from iptm.run import Run
from iptm.trip import Trip
from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon, HorizonPhase
from iptm_controller.measurements import Measurements
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import REFERENCE_WINDOW_S, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import (
    Plan,
    plan_from_variables,
    sample_positions_m,
    variables_from_plan,
)
from iptm_controller.solvers.factory import SolverOptions, build_plain_solver
from iptm_controller.solvers.interface import SolveResult
from iptm_controller.strategy import Strategy
from iptm_controller.temperature_value import NO_VALUE, TemperatureValue
from iptm_core.decision_record import DecisionSeries, SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import nominal_charge_parameters
from iptm_core.routes.route import Route
from iptm_core.state import Command, FloatArray, LeaderPreview, SlopePreview, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant

TOLERANCE = 1e-4
"""Optimality tolerance of the scaled problem."""
NEAR_BARRIER = 1e-2
"""Barrier parameter to start with when the optimum is near."""
MAX_ITERATIONS = 5000
"""Iterations of one solve at most."""
MAX_SOLVES = 12
"""Solves with renewed slope expansion at most."""
SETTLED_M = 10.0
"""The expansion is settled when no position moves by more than this."""
COSTATE_EVERY = 10
"""Interval in ticks at which costates are kept, counted from the end of the trip."""


class WholeTripSolve(TypedDict):
    """One solve around one slope expansion; None stands for a figure that does not exist.

    Attributes:
        status: name of the solver's status.
        time_s: wall time.
        objective: cost of the plan found.
        infeasibility: largest violation of a constraint of the scaled problem.
        moved_m: largest change of a position against the expansion point.
    """

    status: str
    iterations: int
    time_s: float
    objective: float | None
    infeasibility: float | None
    moved_m: float | None


class WholeTripRecord(TypedDict):
    """How a whole trip was solved, as plain values; slacks are the largest violations of limits in the plan.

    Attributes:
        settled: the last solve is usable.
        solves: every solve, in order.
        costate_times_s: instants, rising up to the end of the trip; empty if the last solve is not usable.
        cell_1_costates_1_k: what a kelvin more in cell 1 costs the rest of the trip at these instants, in the
            unit of the strategy's cost.
        cell_n_costates_1_k: the same of cell N.
    """

    settled: bool
    solves: list[WholeTripSolve]
    gap_slack_m: float
    speed_slack_m_s: float
    temperature_slack_k: float
    costate_times_s: list[float]
    cell_1_costates_1_k: list[float]
    cell_n_costates_1_k: list[float]


def solve_whole_trip(
    route: Route,
    plant: Plant,
    strategy: Strategy,
    start: Trajectory,
    tick_s: float,
    model: ModelParameters,
    on_solve: Callable[[WholeTripSolve], None] | None = None,
    value: TemperatureValue = NO_VALUE,
) -> tuple[Trajectory, WholeTripRecord]:
    """Optimise a whole trip.

    Args:
        route: leader and slope, all known.
        plant: the vehicle that the optimum is found for and driven on.
        strategy: cost terms and weights.
        start: a finished run of the same route, as first guess.
        tick_s: step length.
        model: of the problem, see `posed`.
        on_solve: called after every solve.
        value: what a kelvin costs at the end.

    Returns:
        The plant driven with the optimal inputs, and how they were found.
    """
    horizon = Horizon((HorizonPhase(round(route.duration_s / tick_s), tick_s),))
    # The driven trip is far from its optimum; one found for another expansion is near.
    first, further = (
        build_plain_solver(
            horizon,
            model,
            SolverOptions(
                max_iterations=MAX_ITERATIONS,
                tolerance=TOLERANCE,
                initial_barrier=NEAR_BARRIER,
                warm_start_iterations=warm_start,
            ),
        )
        for warm_start in (0, MAX_ITERATIONS)
    )
    grid = ProblemGrid(horizon)
    builder = ProblemDataBuilder(grid, strategy, model)
    leader = _leader_motion(route, horizon)
    slope = SlopePreview(np.asarray(route.slope.positions_m), np.asarray(route.slope.slopes_rad))
    state = plant.initial_state()
    plan = _plan_of(start, horizon)
    solves: list[WholeTripSolve] = []
    usable = False
    costates: FloatArray = np.empty((3, 0))
    for index in range(MAX_SOLVES):
        solver = further if index else first
        expected = sample_positions_m(plan, grid.sample_times_s)
        data = builder.build(state, leader, slope, expected, value=value)
        result = solver.solve(data, variables_from_plan(plan, grid, state))
        found = plan_from_variables(result.variables, grid, state)
        moved = np.abs(found.states[:, StateIndex.POSITION] - plan.states[:, StateIndex.POSITION])
        solves.append(_solve_record(result, float(moved.max())))
        if on_solve is not None:
            on_solve(solves[-1])
        plan, usable = found, result.status.usable
        costates = _temperature_costates(result, grid, strategy)
        if usable and moved.max() <= SETTLED_M:
            break
    times_s, cell_1_1_k, cell_n_1_k = costates.tolist()
    record = WholeTripRecord(
        settled=usable,
        solves=solves,
        gap_slack_m=plan.slacks["gap_slack_m"],
        speed_slack_m_s=plan.slacks["speed_slack_m_s"],
        temperature_slack_k=plan.slacks["temperature_slack_k"],
        costate_times_s=times_s,
        cell_1_costates_1_k=cell_1_1_k,
        cell_n_costates_1_k=cell_n_1_k,
    )
    return _drive(plan, route, plant, state, tick_s), record


def _solve_record(result: SolveResult, moved_m: float) -> WholeTripSolve:
    figures = (result.objective, result.infeasibility, moved_m)
    objective, infeasibility, moved = (value if math.isfinite(value) else None for value in figures)
    return WholeTripSolve(
        status=SolveStatus(result.status).name.lower(),
        iterations=result.iterations,
        time_s=result.time_s,
        objective=objective,
        infeasibility=infeasibility,
        moved_m=moved,
    )


def _temperature_costates(result: SolveResult, grid: ProblemGrid, strategy: Strategy) -> FloatArray:
    """Return instants and costates of both cells in the unit of the strategy's own weights, shape (3, n).

    There are none of a solve that is not usable.
    """
    if not result.status.usable:
        return np.empty((3, 0))
    per_unit = result.costates.reshape(grid.steps, layout.STATES) / layout.STATE_SCALE
    kept = slice((grid.steps - 1) % COSTATE_EVERY, None, COSTATE_EVERY)
    cells = [StateIndex.CELL_1_TEMPERATURE, StateIndex.CELL_N_TEMPERATURE]
    of_cells = per_unit[kept][:, cells].T / strategy.scale
    return np.vstack((grid.horizon.node_times_s[1:][kept], of_cells))


def _leader_motion(route: Route, horizon: Horizon) -> LeaderPreview:
    """The leader from before the start (speed references look back) to the end."""
    before = np.arange(-REFERENCE_WINDOW_S - 1.0, 0.0)
    times = np.concatenate([before, horizon.node_times_s])
    return LeaderPreview(times, route.leader.positions_at(times), route.leader.speeds_at(times))


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
    return Plan(0.0, horizon.node_times_s, states, inputs, horizon.steps)


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


def posed(trip: Trip, parameters: ModelParameters) -> tuple[Strategy, ModelParameters]:
    """Return strategy and model of the problem of a whole trip.

    With all in one currency both are the controller's, but for the lower temperature limit, which cell 1 may
    be below by as much as its controller permits: the mean of the pack is left free, so that the
    optimum is a bound.
    """
    strategy = trip.controller.weighted_strategy()
    if not strategy.in_currency:
        return strategy, nominal_charge_parameters(parameters)
    coldest_k = parameters.limits.min_temperature_k - strategy.coldest_below_limit_k
    limits = replace(parameters.limits, min_temperature_k=coldest_k)
    controller = MpcController(replace(parameters, limits=limits), trip.options)
    return controller.plan_data.builder.strategy, controller.model


def drive_whole_trip(trip: Trip) -> tuple[Run, WholeTripRecord]:
    """Solve a trip as one optimal control problem and drive the plant with its inputs.

    Where it starts from is what the closed loop of the same trip drives; with ``value_beyond_trip`` a kelvin
    has the value at the end that it had in the last decision there.

    Returns:
        The run, and how its problem was solved.

    Raises:
        IptmError: the trip cannot be set up, follows rules of the road, or its strategy optimises nothing.
    """
    strategy = trip.controller.weighted_strategy()
    if strategy.is_rule_based:
        raise ScenarioError(
            f"a whole trip with strategy '{strategy.name}', which optimises nothing; "
            "allowed: strategies with weights"
        )
    if trip.rules.keeps_rules:
        raise ScenarioError(
            "a whole trip with rules of the road; allowed: closed loops, as it knows its leader only"
        )
    values: list[TemperatureValue] = [NO_VALUE]

    def note(_: int, __: Measurements, decision: Decision) -> None:
        if trip.controller.value_beyond_trip and decision.plan is not None:
            values.append(decision.value)

    first = drive_in_memory(trip, on_tick=note)
    plant = plant_for(trip)
    weighted, model = posed(trip, plant.parameters)
    driven = first.trajectory, trip.conditions.period_s
    trajectory, record = solve_whole_trip(
        trip.route, plant, weighted, *driven, model, value=values[-1]
    )
    nothing = DecisionSeries.from_records([], [])
    name = f"whole trip, {first.name}"
    run = replace(first, name=name, trajectory=trajectory, decisions=nothing, reports=())
    return run, record

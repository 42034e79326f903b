"""The closed loop without ROS: the pure parts of plant, bridge and controller, tick by tick.

The order of events is that of the lock-step mode of the nodes, so both give the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iptm_controller.controller import Controller, Decision, Measurements
from iptm_core.routes.route import Route
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray, LeaderState, SlopePreview, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant, PlantStep
from iptm_v2x_bridge.bridge import V2xBridge
from iptm_v2x_bridge.cycle_source import CycleSource

NS_PER_S = 1_000_000_000
NO_SOLVE = -1


@dataclass(frozen=True)
class DecisionLog:
    """What the controller answered, one entry per tick, shape (n - 1,) for n trajectory rows.

    Attributes:
        status: ``SolveStatus`` of the solve, -1 where no problem was posed.
        rung: rung of the fallback ladder.
        iterations: solver iterations.
        solve_time_s: wall time of the solve.
        gap_slack_m: largest predicted violation of a gap limit.
        speed_slack_m_s: largest predicted violation of a speed limit.
        temperature_slack_k: largest predicted violation of a temperature limit.
        limiter_active: whether the last limiter changed the command.
    """

    status: NDArray[np.int64]
    rung: NDArray[np.int64]
    iterations: NDArray[np.int64]
    solve_time_s: FloatArray
    gap_slack_m: FloatArray
    speed_slack_m_s: FloatArray
    temperature_slack_k: FloatArray
    limiter_active: NDArray[np.bool_]


@dataclass(frozen=True)
class ClosedLoopRun:
    """A finished trip."""

    trajectory: Trajectory
    log: DecisionLog


def run_closed_loop(
    route: Route,
    plant: Plant,
    controller: Controller,
    bridge_settings: PreviewSettings | None = None,
    on_tick: Callable[[int, Measurements, Decision], None] | None = None,
) -> ClosedLoopRun:
    """Drive a route from standstill.

    Args:
        route: leader and slope.
        plant: the simulated vehicle; it must know the same slope.
        controller: a fresh controller.
        bridge_settings: preview length and imperfections.
        on_tick: called after every decision with the tick, what was measured and what was decided.

    Returns:
        The trajectory and the controller's answers.
    """
    tick_s = controller.options.tick_s
    ticks = round(route.duration_s / tick_s)
    source = CycleSource(route)
    bridge = V2xBridge(source, bridge_settings)
    slope = source.slope_ahead()
    step = plant.observe(plant.initial_state())
    recorder, answers = TripRecorder(), _DecisionRecorder()
    for tick in range(ticks):
        leader, measured = _measure(bridge, slope, step.state, tick, tick_s)
        decision = controller.decide(measured)
        recorder.row(step, leader)
        answers.add(decision)
        if on_tick is not None:
            on_tick(tick, measured, decision)
        step = plant.advance(step.state, decision.command, tick_s)
    leader, _ = _measure(bridge, slope, step.state, ticks, tick_s)
    recorder.row(step, leader)
    return ClosedLoopRun(recorder.trajectory(), answers.log())


def _measure(
    bridge: V2xBridge, slope: SlopePreview, state: VehicleState, tick: int, tick_s: float
) -> tuple[LeaderState, Measurements]:
    answer = bridge.answer(round(tick * tick_s * NS_PER_S))
    return answer.leader, Measurements(state, answer.leader, answer.preview, slope)


class TripRecorder:
    """Collects the rows of a trajectory."""

    def __init__(self) -> None:
        self._rows: list[dict[str, float]] = []

    def row(self, step: PlantStep, leader: LeaderState) -> None:
        """Add what is observed at one instant."""
        state = step.state
        self._rows.append(
            {
                "time_s": state.time_s,
                "position_m": state.position_m,
                "speed_m_s": state.speed_m_s,
                "acceleration_m_s2": state.acceleration_m_s2,
                "compressor_power_w": state.compressor_power_w,
                "cell_1_temperature_k": state.cell_1_temperature_k,
                "cell_n_temperature_k": state.cell_n_temperature_k,
                "cell_1_capacity_loss": state.cell_1_capacity_loss,
                "cell_n_capacity_loss": state.cell_n_capacity_loss,
                "coolant_inlet_temperature_k": step.coolant_inlet_k,
                "coolant_outlet_temperature_k": step.coolant_outlet_k,
                "traction_power_w": step.traction_power_w,
                "auxiliary_power_w": step.auxiliary_power_w,
                "battery_power_w": step.battery_power_w,
                "chiller_heat_w": step.chiller_heat_w,
                "leader_position_m": leader.position_m,
                "leader_speed_m_s": leader.speed_m_s,
            }
        )

    def trajectory(self) -> Trajectory:
        """The rows so far, as arrays."""
        return Trajectory.from_arrays(
            {key: [row[key] for row in self._rows] for key in self._rows[0]}
        )


class _DecisionRecorder:
    """Collects the controller's answers."""

    def __init__(self) -> None:
        self._answers: list[tuple[float, ...]] = []

    def add(self, decision: Decision) -> None:
        result, plan = decision.result, decision.plan
        slacks = plan.slacks if plan is not None else None
        nan = float("nan")
        self._answers.append(
            (
                NO_SOLVE if result is None else int(result.status),
                int(decision.rung),
                0 if result is None else result.iterations,
                0.0 if result is None else result.time_s,
                nan if slacks is None else slacks.gap_m,
                nan if slacks is None else slacks.speed_m_s,
                nan if slacks is None else slacks.temperature_k,
                decision.limited.active,
            )
        )

    def log(self) -> DecisionLog:
        answers = np.array(self._answers, dtype=float).reshape(len(self._answers), -1).T
        return DecisionLog(
            status=answers[0].astype(int),
            rung=answers[1].astype(int),
            iterations=answers[2].astype(int),
            solve_time_s=answers[3],
            gap_slack_m=answers[4],
            speed_slack_m_s=answers[5],
            temperature_slack_k=answers[6],
            limiter_active=answers[7].astype(bool),
        )

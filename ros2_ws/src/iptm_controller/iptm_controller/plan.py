"""The predicted plan of one solve in physical units, and its shift to the next tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_core.state import ROUNDING_S, Command, FloatArray, VehicleState

SLACKS = {
    "gap_slack_m": (InputIndex.GAP_SHORT, InputIndex.GAP_LONG),
    "speed_slack_m_s": (InputIndex.SPEED_EXCESS,),
    "temperature_slack_k": (InputIndex.TEMPERATURE_EXCESS,),
}
"""Slacks of each group of soft limits, by the field of `DecisionRecord` for the largest one."""


@dataclass(frozen=True)
class Plan:
    """States at the nodes and inputs of the steps.

    Attributes:
        start_s: trip time of the first node.
        node_times_s: times relative to ``start_s``, shape (N + 1,).
        states: order of ``StateIndex``, absolute positions, shape (N + 1, 6).
        inputs: order of ``InputIndex``, shape (N, 6).
        motion_steps: steps in which the motion is optimised; later positions and speeds mean nothing.
    """

    start_s: float
    node_times_s: FloatArray
    states: FloatArray
    inputs: FloatArray
    motion_steps: int

    def command_at(self, time_s: float) -> Command:
        """Return the planned inputs of the step that holds at a trip time; the last step is held on."""
        elapsed = time_s - self.start_s
        step = int(self.node_times_s.searchsorted(elapsed + ROUNDING_S, side="right")) - 1
        step = min(max(step, 0), self.inputs.shape[0] - 1)
        row = self.inputs[step].tolist()
        return Command(row[InputIndex.ACCELERATION], row[InputIndex.COMPRESSOR_POWER])

    @property
    def motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Trip times, positions and speeds at the nodes of the motion, shape (motion_steps + 1,) each."""
        nodes = slice(self.motion_steps + 1)
        states = self.states[nodes]
        return (
            self.start_s + self.node_times_s[nodes],
            states[:, StateIndex.POSITION],
            states[:, StateIndex.SPEED],
        )

    @property
    def slacks(self) -> dict[str, float]:
        """Largest violation of each group of `SLACKS`; the solver's own round-off below zero is cut."""
        worst = np.maximum.reduce(self.inputs).tolist()
        return {name: max(0.0, *[worst[i] for i in group]) for name, group in SLACKS.items()}


def plan_from_variables(variables: FloatArray, grid: ProblemGrid, state: VehicleState) -> Plan:
    """Unscale a solution; positions become absolute."""
    scaled_states, scaled_inputs = grid.split(variables)
    states = scaled_states * layout.STATE_SCALE + layout.STATE_OFFSET
    states[:, StateIndex.POSITION] += state.position_m
    return Plan(
        start_s=state.time_s,
        node_times_s=grid.horizon.node_times_s,
        states=states,
        inputs=scaled_inputs * layout.INPUT_SCALE,
        motion_steps=grid.horizon.motion_steps,
    )


def variables_from_plan(plan: Plan, grid: ProblemGrid, state: VehicleState) -> FloatArray:
    """Scale a plan into the optimiser's variables, the inverse of ``plan_from_variables``."""
    relative = plan.states - layout.STATE_OFFSET
    relative[:, StateIndex.POSITION] -= state.position_m
    return grid.join(relative / layout.STATE_SCALE, plan.inputs / layout.INPUT_SCALE)


class PlanShifter:
    """Initial guesses for the next tick: the last plan moved on in time, on any grid.

    A new step takes the time average of the old piecewise constant inputs over its interval; beyond the
    old horizon the last input is held. Position and speed follow exactly from the present state,
    temperatures are interpolated.
    """

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        self._lengths_s = horizon.step_lengths_s
        self._nodes_s = horizon.node_times_s
        self._motion_steps = horizon.motion_steps

    def cold_start(self, state: VehicleState) -> Plan:
        """Return a plan that keeps speed and compressor power as they are."""
        steps = self._horizon.steps
        inputs = np.zeros((steps, layout.INPUTS))
        inputs[:, InputIndex.COMPRESSOR_POWER] = state.compressor_power_w
        temperatures = np.tile(
            [state.cell_1_temperature_k, state.cell_n_temperature_k], (steps + 1, 1)
        )
        return self._roll_out(state, inputs, temperatures)

    def shift(self, plan: Plan, state: VehicleState) -> Plan:
        """Return the plan as seen from a later state."""
        moved_s = state.time_s - plan.start_s
        held = plan.inputs.copy()
        held[self._motion_steps :, InputIndex.ACCELERATION] = held[
            self._motion_steps - 1, InputIndex.ACCELERATION
        ]
        inputs = self._average_inputs(held, moved_s)
        inputs[self._motion_steps :, InputIndex.ACCELERATION] = 0.0
        times = np.minimum(self._nodes_s + moved_s, self._nodes_s[-1])
        temperatures = np.column_stack(
            [
                np.interp(times, self._nodes_s, plan.states[:, index])
                for index in (StateIndex.CELL_1_TEMPERATURE, StateIndex.CELL_N_TEMPERATURE)
            ]
        )
        return self._roll_out(state, inputs, temperatures)

    def _average_inputs(self, inputs: FloatArray, moved_s: float) -> FloatArray:
        edges = np.minimum(self._nodes_s + moved_s, self._nodes_s[-1])
        integral = np.vstack(
            [np.zeros(layout.INPUTS), np.cumsum(inputs * self._lengths_s[:, None], axis=0)]
        )
        at_edges = np.column_stack(
            [np.interp(edges, self._nodes_s, integral[:, i]) for i in range(layout.INPUTS)]
        )
        covered_s = np.diff(edges)
        beyond_s = self._lengths_s - covered_s
        total = np.diff(at_edges, axis=0) + beyond_s[:, None] * inputs[-1]
        averaged: FloatArray = total / self._lengths_s[:, None]
        return averaged

    def _roll_out(self, state: VehicleState, inputs: FloatArray, temperatures: FloatArray) -> Plan:
        lengths = self._lengths_s
        acceleration = inputs[:, InputIndex.ACCELERATION]
        states = np.empty((lengths.size + 1, layout.STATES))
        speeds = state.speed_m_s + np.concatenate([[0.0], np.cumsum(acceleration * lengths)])
        travelled = np.cumsum(0.5 * (speeds[:-1] + speeds[1:]) * lengths)
        states[:, StateIndex.POSITION] = state.position_m + np.concatenate([[0.0], travelled])
        states[:, StateIndex.SPEED] = speeds
        states[:, StateIndex.CELL_1_TEMPERATURE : StateIndex.CELL_N_TEMPERATURE + 1] = temperatures
        states[0, StateIndex.CELL_1_TEMPERATURE] = state.cell_1_temperature_k
        states[0, StateIndex.CELL_N_TEMPERATURE] = state.cell_n_temperature_k
        states[0, StateIndex.LAST_ACCELERATION] = state.acceleration_m_s2
        states[0, StateIndex.LAST_COMPRESSOR_POWER] = state.compressor_power_w
        states[1:, StateIndex.LAST_ACCELERATION] = acceleration
        states[1:, StateIndex.LAST_COMPRESSOR_POWER] = inputs[:, InputIndex.COMPRESSOR_POWER]
        return Plan(state.time_s, self._nodes_s, states, inputs, self._motion_steps)


def sample_positions_m(plan: Plan, sample_times_s: FloatArray) -> FloatArray:
    """Return planned absolute positions at times relative to the plan's start."""
    steps = np.clip(
        np.searchsorted(plan.node_times_s, sample_times_s, side="right") - 1,
        0,
        plan.inputs.shape[0] - 1,
    )
    elapsed = sample_times_s - plan.node_times_s[steps]
    speed = plan.states[steps, StateIndex.SPEED]
    acceleration = plan.inputs[steps, InputIndex.ACCELERATION]
    positions: FloatArray = plan.states[steps, StateIndex.POSITION] + elapsed * (
        speed + 0.5 * elapsed * acceleration
    )
    return positions

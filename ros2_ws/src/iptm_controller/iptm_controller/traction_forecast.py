"""Traction powers of the thermal phases of a horizon, from the best knowledge that there is.

As far as a preview of the leader reaches, the ego vehicle is taken to drive its way smoothly: at the leader's
mean speed over a window of time, which is what following within the gap limits leads to. Beyond, a step
takes the distribution of the powers of the trip so far. The powers of a step are sorted and averaged in a few
groups of equal duration, so that what is convex in them can be averaged over the groups.
"""

from __future__ import annotations

import math

import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import POWER_LEVELS, ProblemGrid
from iptm_controller.ocp.layout import ThermalSampleIndex
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.state import FloatArray, LeaderPreview, SlopePreview, VehicleState

SMOOTHING_S = 25.0
"""Half of the window: the default strategy drives the comprehensive cycle as smoothly as that."""
MEMORY_TICKS = 1200
"""Ticks of the trip so far that count."""


class TractionForecaster:
    """Follows the trip and foresees the traction powers of the thermal steps.

    Attributes:
        powers_w: traction powers of the trip so far.
        speeds_m_s: speeds at which they were measured.
        until_s: when the newest one was measured.
    """

    def __init__(self, parameters: ModelParameters, grid: ProblemGrid) -> None:
        self._parameters = parameters
        self._kinds = [kind for kind in grid.stages if kind.thermal]
        nodes = grid.horizon.node_times_s
        self._times_s = []
        for kind in self._kinds:
            inside = POWER_LEVELS * max(2, round(kind.step_s / POWER_LEVELS))
            parts = (np.arange(inside) + 0.5) / inside * kind.step_s
            self._times_s.append(nodes[kind.steps][:, None] + parts)
        self.powers_w: tuple[float, ...] = ()
        self.speeds_m_s: tuple[float, ...] = ()
        self.until_s = -math.inf

    def remember(self, state: VehicleState, slope: SlopePreview) -> None:
        """Add the present power to the powers of the trip; an earlier state begins a new one."""
        if state.time_s < self.until_s:
            self.powers_w = self.speeds_m_s = ()
        self.until_s = state.time_s
        slope_rad = float(np.interp(state.position_m, slope.positions_m, slope.slopes_rad))
        power = electric_traction_power_w(
            state.speed_m_s, state.acceleration_m_s2, slope_rad, self._parameters
        )
        self.powers_w = (*self.powers_w, float(power))[-MEMORY_TICKS:]
        self.speeds_m_s = (*self.speeds_m_s, state.speed_m_s)[-MEMORY_TICKS:]

    def samples(
        self,
        state: VehicleState,
        leader: LeaderPreview,
        known_s: float,
        slope: SlopePreview,
    ) -> FloatArray:
        """Return the parameters of the samples of all thermal steps.

        Args:
            known_s: how far ahead the leader's motion is a prediction and not a guess.

        Returns:
            Shape (samples, 7), places of ``ThermalSampleIndex`` filled.
        """
        usual_w = _levels(np.array(self.powers_w)[None, :])[0]
        usual_m_s = float(np.mean(self.speeds_m_s))
        tables = []
        for kind, times in zip(self._kinds, self._times_s, strict=True):
            powers = np.tile(usual_w, (kind.count, 1))
            speeds = np.full(kind.count, usual_m_s)
            ends = times[:, -1] + 0.5 * (times[0, 1] - times[0, 0])
            known = int(np.searchsorted(ends, known_s + 1e-6, side="right"))
            if known > 0:
                power, speed = self._foreseen(
                    state, leader, known_s, slope, state.time_s + times[:known]
                )
                powers[:known], speeds[:known] = _levels(power), speed.mean(axis=1)
            table = np.zeros((kind.count, POWER_LEVELS, layout.SAMPLE_PARAMETERS))
            table[:, :, ThermalSampleIndex.TRACTION_POWER] = powers
            table[:, :, ThermalSampleIndex.SPEED] = speeds[:, None]
            tables.append(table.reshape(-1, layout.SAMPLE_PARAMETERS))
        return np.concatenate(tables)

    def _foreseen(
        self,
        state: VehicleState,
        leader: LeaderPreview,
        known_s: float,
        slope: SlopePreview,
        times_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return traction power and speed of a vehicle that smooths the leader's way, shapes of the times."""
        first_s, last_s = state.time_s, state.time_s + known_s
        flat = times_s.ravel()
        before = np.maximum(flat - SMOOTHING_S, first_s)
        after = np.minimum(flat + SMOOTHING_S, last_s)
        moved, _ = leader.at(np.concatenate([before, after, flat]))
        speed = (moved[flat.size : 2 * flat.size] - moved[: flat.size]) / (after - before)
        speed = np.maximum(speed, 0.0)
        acceleration = np.gradient(speed, flat)
        gap_m = leader.at(np.array([first_s]))[0][0] - state.position_m
        position = moved[2 * flat.size :] - gap_m
        slope_rad = np.interp(position, slope.positions_m, slope.slopes_rad)
        power = electric_traction_power_w(speed, acceleration, slope_rad, self._parameters)
        return np.asarray(power).reshape(times_s.shape), speed.reshape(times_s.shape)


def _levels(powers_w: FloatArray) -> FloatArray:
    """Sort the powers of every row and average groups of equal size, shape (rows, levels)."""
    ordered = np.sort(powers_w, axis=1)
    edges = np.linspace(0.0, ordered.shape[1], POWER_LEVELS + 1)
    # Means between fractional edges, from the integral over the sorted powers.
    integral = np.concatenate([np.zeros((ordered.shape[0], 1)), np.cumsum(ordered, axis=1)], axis=1)
    columns = np.arange(ordered.shape[1] + 1.0)
    at_edges = np.stack([np.interp(edges, columns, row) for row in integral])
    levels: FloatArray = np.diff(at_edges, axis=1) / np.diff(edges)
    return levels

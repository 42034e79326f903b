"""How much power the pack gives and takes, and what of the motion that leaves: for plan and command.

Packs without limits of their own give any power; only where sensors of the pack have failed is that reduced.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from iptm_controller.measurements import slope_at_rad
from iptm_controller.ocp.data import UNBOUNDED_W
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.electrical import battery_power_w
from iptm_core.physics.pack_limits import UNLIMITED, PowerLimits, power_limits
from iptm_core.physics.power_thermal import CellPair, electric_traction_power_w
from iptm_core.state import Command, FloatArray, SlopePreview, VehicleState

REFERENCE_RATE_1_H = 2.0
"""Power over energy of a pack without limits, of which a failed sensor leaves a share."""
GENTLE_M_S2 = -0.5
"""A pack that gives less than the road asks for lets the car slow down, but does not brake it harder."""
_BISECTIONS = 24


class PowerAuthority:
    """Limits of the power of the pack at a tick.

    Args:
        parameters: of the vehicle, at any charge.
        tick_s: for which a command holds.
        times_s: ends of the steps of the motion in a plan, from its beginning.

    Attributes:
        limits: of the tick, `UNLIMITED` where nothing limits the pack.
    """

    def __init__(
        self, parameters: ModelParameters, tick_s: float, times_s: FloatArray | None = None
    ) -> None:
        self._parameters = parameters
        self._is_limited = parameters.pack_limits.limited
        self._tick_s = tick_s
        self._times_s = np.empty(0) if times_s is None else times_s
        energy_wh = parameters.cell.nominal_capacity_ah * parameters.pack.parallel
        energy_wh *= parameters.pack.open_circuit_voltage_v
        self._reference_w = REFERENCE_RATE_1_H * energy_wh
        self._state: VehicleState | None = None
        self._slope: SlopePreview | None = None
        self.limits = UNLIMITED

    def update(self, state: VehicleState, slope: SlopePreview, share: float = 1.0) -> None:
        """Work out the limits of a tick.

        Args:
            share: what the sensors of the pack leave of its power.
        """
        self._state, self._slope = state, slope
        if self._is_limited:
            cells = CellPair(
                state.cell_1_temperature_k,
                state.cell_n_temperature_k,
                state.cell_1_capacity_loss,
                state.cell_n_capacity_loss,
            )
            known = power_limits(cells, state.state_of_charge, self._parameters, self._tick_s)
        else:
            known = PowerLimits(self._reference_w, self._reference_w) if share < 1.0 else UNLIMITED
        self.limits = known.reduced(share) if share < 1.0 else known

    @property
    def charge_w(self) -> float:
        """Largest charging power that plans count on, finite."""
        return min(self.limits.charge_w, UNBOUNDED_W)

    def within(self, command: Command) -> Command:
        """Return a command whose acceleration the pack can supply."""
        state, slope = self._state, self._slope
        if state is None or slope is None or math.isinf(self.limits.discharge_w):
            return command
        slope_rad = slope_at_rad(slope, state.position_m)
        largest = self.largest_acceleration_m_s2(
            state.speed_m_s, slope_rad, command.compressor_power_w
        )
        slower = min(command.acceleration_m_s2, largest)
        return replace(command, acceleration_m_s2=slower)

    def slower(self, speeds_m_s: FloatArray | None) -> FloatArray | None:
        """Return the speed limits at the ends of the motion steps, lowered to what the car can reach."""
        state, slope = self._state, self._slope
        if state is None or slope is None or math.isinf(self.limits.discharge_w):
            return speeds_m_s
        reached = self._reachable_speeds_m_s(state, slope)
        if speeds_m_s is not None:
            return np.minimum(reached, speeds_m_s)
        return reached if (reached < self._parameters.limits.max_speed_m_s).any() else None

    def largest_acceleration_m_s2(
        self, speed_m_s: float, slope_rad: float, thermal_w: float = 0.0
    ) -> float:
        """Return the largest acceleration that the pack can supply, not below `GENTLE_M_S2`."""
        largest, most_w = self._parameters.limits.max_acceleration_m_s2, self.limits.discharge_w
        if self._drawn_w(speed_m_s, largest, slope_rad, thermal_w) <= most_w:
            return largest
        low, high = GENTLE_M_S2, largest
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if self._drawn_w(speed_m_s, middle, slope_rad, thermal_w) <= most_w:
                low = middle
            else:
                high = middle
        return low

    def _reachable_speeds_m_s(self, state: VehicleState, slope: SlopePreview) -> FloatArray:
        """Return the speeds that the car cannot exceed at the ends of the motion steps."""
        speed, position, now_s = state.speed_m_s, state.position_m, 0.0
        top = self._parameters.limits.max_speed_m_s
        reached = []
        for end_s in self._times_s.tolist():
            while now_s < end_s - 1e-9:
                length_s = min(1.0, end_s - now_s)
                slope_rad = slope_at_rad(slope, position)
                by = self.largest_acceleration_m_s2(speed, slope_rad)
                after = min(max(speed + by * length_s, 0.0), top)
                position += 0.5 * (speed + after) * length_s
                speed, now_s = after, now_s + length_s
            reached.append(speed)
        speeds: FloatArray = np.array(reached)
        return speeds

    def _drawn_w(
        self, speed_m_s: float, acceleration_m_s2: float, slope_rad: float, thermal_w: float
    ) -> float:
        """Return the terminal power at the end of a tick, where it is largest."""
        values = self._parameters
        faster = max(speed_m_s + max(acceleration_m_s2, 0.0) * self._tick_s, 0.0)
        traction = electric_traction_power_w(faster, acceleration_m_s2, slope_rad, values)
        auxiliary_w = values.cooling.auxiliary_power_w
        return float(
            battery_power_w(traction, abs(thermal_w), auxiliary_w, values.pack, values.powertrain)
        )

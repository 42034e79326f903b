"""Intervals of the pack within what it takes and gives: friction brakes supply what it does not take.

A pack without limits of its own takes any power until it is full, and gives any until it is empty; only
then are its powers bounded, so that otherwise every number stays as it is without any bound.
"""

from __future__ import annotations

import math

from iptm_core.errors import StateError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import charge_after, depends_on_charge, pack_capacity_ah
from iptm_core.physics.pack_limits import PowerLimits, least_traction_power_w, power_limits
from iptm_core.physics.power_thermal import CellPair
from iptm_core.settings import ThermalModel
from iptm_core.state import FloatArray, FullChannelState, VehicleState
from iptm_plant_sim.actuators import Motion
from iptm_plant_sim.channel_integrator import ChannelIntegrator
from iptm_plant_sim.integrator import IntervalIntegrator, IntervalResult, PowerBounds


class PackIntegration:
    """Integrates intervals of any number of sub-steps for one parameter set.

    Attributes:
        depends_on_charge: whether states need a state of charge.
    """

    def __init__(self, parameters: ModelParameters, thermal_model: ThermalModel) -> None:
        self._parameters = parameters
        self._is_limited = parameters.pack_limits.limited
        self.depends_on_charge = depends_on_charge(parameters.charge) or self._is_limited
        self._integrators: dict[bool, IntervalIntegrator] = {}
        self._channels: dict[bool, ChannelIntegrator] = {}
        if thermal_model is ThermalModel.FULL_CHANNEL:
            self._channels = {
                bounded: ChannelIntegrator(parameters, bounded=bounded) for bounded in (False, True)
            }

    def charge_at_end(self, state: VehicleState, result: IntervalResult) -> float:
        """Return the state of charge behind an interval."""
        loss = 0.5 * (state.cell_1_capacity_loss + state.cell_n_capacity_loss)
        capacity_ah = pack_capacity_ah(self._parameters, loss)
        return charge_after(state.state_of_charge, result.charge_c, capacity_ah)

    def limits(self, state: VehicleState, duration_s: float) -> PowerLimits:
        """Return what the pack takes and gives in an interval."""
        charge = state.state_of_charge
        return power_limits(cells_of(state), charge, self._parameters, duration_s)

    def integrate(
        self, state: VehicleState, power_w: float, motion: Motion, slopes_rad: FloatArray
    ) -> IntervalResult:
        """Integrate an interval within the limits; one that asks the pack for too much is not finite.

        Args:
            power_w: of the thermal actuator, negative for the heater.
        """
        if not self._is_limited:
            result = self.unbounded(state, power_w, motion, slopes_rad)
            end = self.charge_at_end(state, result)
            if math.isnan(end) or 0.0 <= end <= 1.0:
                return result
        limits = self.limits(state, float(motion.lengths_s.sum()))
        least_w = least_traction_power_w(limits.charge_w, power_w, self._parameters)
        bounds = PowerBounds(least_w, limits.discharge_w)
        return self._integrate(state, power_w, motion, slopes_rad, bounds)

    def unbounded(
        self, state: VehicleState, power_w: float, motion: Motion, slopes_rad: FloatArray
    ) -> IntervalResult:
        """Integrate an interval whatever the pack takes and gives."""
        return self._integrate(state, power_w, motion, slopes_rad, None)

    def _integrate(
        self,
        state: VehicleState,
        power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        bounds: PowerBounds | None,
    ) -> IntervalResult:
        bounded, charge = bounds is not None, state.state_of_charge
        if self._channels:
            if not isinstance(state, FullChannelState):
                raise StateError("state has two cells; allowed: a state of the full channel")
            channel = self._channels[bounded]
            return channel.integrate(state.cells, power_w, motion, slopes_rad, charge, bounds)
        integrator = self._integrators.get(bounded)
        if integrator is None:
            integrator = IntervalIntegrator(self._parameters, bounded=bounded)
            self._integrators[bounded] = integrator
        return integrator.integrate(cells_of(state), power_w, motion, slopes_rad, charge, bounds)


def cells_of(state: VehicleState) -> CellPair:
    """Return the first and the last cell of a state."""
    return CellPair(
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.cell_1_capacity_loss,
        state.cell_n_capacity_loss,
    )

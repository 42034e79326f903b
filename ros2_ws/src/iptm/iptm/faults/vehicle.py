"""A vehicle whose commands come late, whose brakes are weak, that slips, or that does not cool."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import Delay
from iptm_core.settings import ThermalModel
from iptm_core.state import NS_PER_S, Command, VehicleState
from iptm_plant_sim.pack_integration import PackIntegration
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep

STANDING_FLOW = 1e-6
"""Share of the heat transfer that is left where the coolant stands; above 0, as the loop is solved for it."""


class FaultyPlant(Plant):
    """The simulated vehicle with faults of its actuators, its cooling and the road under it.

    Unlike the base class it stores the commands of a trip; a state earlier than the last starts a new trip.
    """

    def __init__(self, faults: Iterable[Fault], *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        own = at_places(faults, FaultPlace.VEHICLE)
        self._delay: Delay[Command] = Delay(own, FaultKind.COMMAND_DELAYED)
        self._own = own
        self._steeper_rad = 0.0
        self._with_flow = self._without_flow = self._pack
        if any(fault.kind is FaultKind.PUMP_OFF for fault in own):
            values, all_cells = self.parameters, self._has_all_cells
            h_w_k = STANDING_FLOW * values.cooling.convective_coefficient_w_k
            # The heater warms coolant that stands, not the cells.
            cooling = replace(
                values.cooling, convective_coefficient_w_k=h_w_k, heater_performance=0.0
            )
            model = ThermalModel.FULL_CHANNEL if all_cells else ThermalModel.TWO_CELL
            self._without_flow = PackIntegration(replace(values, cooling=cooling), model)
        on_map = self._slope_at
        self._slope_at = lambda positions_m: on_map(positions_m) + self._steeper_rad

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        """Carry out a command for one interval; see ``Plant``."""
        now_ns = round(state.time_s * NS_PER_S)
        command = self._delay.delayed(now_ns, command)
        self.brake_strength = min(self._sizes(FaultKind.BRAKES_WEAK, now_ns), default=1.0)
        self.road_friction = min(self._sizes(FaultKind.ROAD_SLIPPERY, now_ns), default=0.0)
        self._steeper_rad = sum(self._sizes(FaultKind.ROAD_STEEPER, now_ns))
        if self._hits(FaultKind.COMPRESSOR_DEAD, now_ns):
            state = replace(state, compressor_power_w=0.0)
            command = replace(command, compressor_power_w=0.0)
        stands = self._hits(FaultKind.PUMP_OFF, now_ns)
        self._pack = self._without_flow if stands else self._with_flow
        step = super().advance(state, command, duration_s)
        if not stands:
            return step
        mean_k = 0.5 * (step.state.cell_1_temperature_k + step.state.cell_n_temperature_k)
        return replace(
            step, coolant_inlet_temperature_k=mean_k, coolant_outlet_temperature_k=mean_k
        )

    def _hits(self, kind: FaultKind, time_ns: int) -> bool:
        return any(one.kind is kind and one.hits(time_ns) for one in self._own)

    def _sizes(self, kind: FaultKind, time_ns: int) -> list[float]:
        return [one.magnitude for one in self._own if one.kind is kind and one.hits(time_ns)]

"""A vehicle that carries out its commands late, brakes more weakly than its model, or slips."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import Delay
from iptm_core.state import NS_PER_S, Command, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep


class FaultyPlant(Plant):
    """The simulated vehicle with faults of its actuators and of the road under it.

    Unlike the base class it stores the commands of a trip; a state earlier than the last starts a new trip.
    """

    def __init__(self, faults: Iterable[Fault], *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        own = at_places(faults, FaultPlace.VEHICLE)
        self._delay: Delay[Command] = Delay(own, FaultKind.COMMAND_DELAYED)
        self._own = own
        self._steeper_rad = 0.0
        on_map = self._slope_at
        self._slope_at = lambda positions_m: on_map(positions_m) + self._steeper_rad

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        """Carry out a command for one interval; see ``Plant``."""
        now_ns = round(state.time_s * NS_PER_S)
        command = self._delay.delayed(now_ns, command)
        self.brake_strength = min(self._sizes(FaultKind.BRAKES_WEAK, now_ns), default=1.0)
        self.road_friction = min(self._sizes(FaultKind.ROAD_SLIPPERY, now_ns), default=0.0)
        self._steeper_rad = sum(self._sizes(FaultKind.ROAD_STEEPER, now_ns))
        return super().advance(state, command, duration_s)

    def _sizes(self, kind: FaultKind, time_ns: int) -> list[float]:
        return [one.magnitude for one in self._own if one.kind is kind and one.hits(time_ns)]

"""A vehicle that carries out its commands late, or brakes more weakly than its model."""

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
    """The simulated vehicle with faults of its actuators.

    Unlike the base class it stores the commands of a trip; a state earlier than the last starts a new trip.
    """

    def __init__(self, faults: Iterable[Fault], *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        own = at_places(faults, FaultPlace.VEHICLE)
        self._delay: Delay[Command] = Delay(own, FaultKind.COMMAND_DELAYED)
        self._weaknesses = tuple(fault for fault in own if fault.kind is FaultKind.BRAKES_WEAK)

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        """Carry out a command for one interval; see ``Plant``."""
        now_ns = round(state.time_s * NS_PER_S)
        command = self._delay.delayed(now_ns, command)
        shares = (fault.magnitude for fault in self._weaknesses if fault.hits(now_ns))
        self.brake_strength = min(shares, default=1.0)
        return super().advance(state, command, duration_s)

"""Parameters of the plant node and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.declaration import Scalar, declared, parameter, parameter_specs, plain
from iptm_core.errors import StateError
from iptm_core.road_ahead import LeaderSourceSettings
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain
from iptm_core.settings import (
    FrameSettings,
    LeaderSource,
    LostControllerSettings,
    PaceSettings,
    TickSettings,
    TripSettings,
    VehicleAheadSettings,
    VehicleSettings,
)
from iptm_core.state import NS_PER_S
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_kinds import plant_kind
from iptm_plant_sim.trip import PlantTrip

WAIT = "wait"
EXIT = "exit"
PLANT_STATE = "plant"
_OF_A_STATE = (
    "cycle",
    "slope",
    "parameter_set",
    "overrides",
    "period_s",
    "thermal_model",
    "integration_step_s",
    *(spec.name for spec in parameter_specs(SafetyMonitorSettings)),
)


@dataclass(frozen=True)
class PlantNodeParameters(
    LostControllerSettings,
    FrameSettings,
    TickSettings,
    PaceSettings,
    VehicleSettings,
    TripSettings,
):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    vehicle_ahead: str = declared(VehicleAheadSettings, "vehicle_ahead")
    leader_source: LeaderSource = declared(LeaderSourceSettings, "leader_source")
    start_paused: bool = parameter(
        default=False,
        description="publish nothing before the service plant/resume, or plant/step, which leads to the "
        "first state; else the trip begins when a controller answers that state",
    )
    at_end: str = parameter(
        EXIT,
        "when the trip has ended: end the process, or wait for the service plant/reset",
        choices=(EXIT, WAIT),
    )
    state_folder: str = parameter(
        "states", "folder for the service plant/save_state, made when it is needed"
    )
    start_state: str = parameter(
        "", "file of the service plant/save_state to start from; empty starts at the start"
    )
    linger_s: float = parameter(
        1.0, "wall time between the last message and the end of the process", "s", 0.0, 60.0
    )

    def build_trip(self) -> PlantTrip:
        """Return the trip, the vehicle at its start."""
        model = self.model().values
        route = self.trip_route(model.gap.initial_gap_m)
        plant = self.build_plant(
            model, route.slope.slope_at, self.integration_step_s, self.thermal_model, self
        )
        trip = PlantTrip(plant, route.duration_s, self.period_s, *self._start(plant))
        trip.warm_up()
        return trip

    def lead_motion(self) -> LeaderMotion | None:
        """Return the motion of the vehicle ahead where the plant plays the range sensor, else None."""
        measured = {LeaderSource.RANGE_SENSOR, LeaderSource.RANGE_SENSOR_AND_CAM}
        if self.leader_source not in measured:
            return None
        return self.trip_route(self.model().values.gap.initial_gap_m).leader

    def build_plant(self, *arguments: Any) -> Plant:
        """Return the vehicle; the arguments are passed to ``Plant``."""
        return plant_kind(self.plant)(*arguments)

    def saved_state(self, trip: PlantTrip) -> SavedState:
        """Return what a file needs to hold to go on from where a trip stands."""
        return SavedState(PLANT_STATE, trip.stamp_ns, self._kept(), to_plain(trip.step))

    def _start(self, plant: Plant) -> tuple[PlantStep, int]:
        """Return where the trip starts and how many ticks it has driven there."""
        if not self.start_state:
            return plant.observe(plant.initial_state(self.start_position_m)), 0
        saved = read_state(Path(self.start_state), PLANT_STATE, self._kept())
        tick, rest_ns = divmod(saved.stamp_ns, round(self.period_s * NS_PER_S))
        if rest_ns:
            raise StateError(
                f"{self.start_state} is of {saved.stamp_ns} ns; allowed: whole periods"
            )
        step = from_plain(PlantStep, saved.state)
        plant.check(step.state)
        return step, tick

    def _kept(self) -> dict[str, Scalar]:
        """Return the settings that the rest of a trip depends on."""
        return {name: plain(getattr(self, name)) for name in _OF_A_STATE}

"""Parameters of the plant node and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import parameter
from iptm_core.settings import (
    FrameSettings,
    IntegrationSettings,
    ModelSettings,
    PaceSettings,
    TickSettings,
    TripSettings,
)
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.trip import Trip

STOP = "stop"
WAIT = "wait"
EXIT = "exit"


@dataclass(frozen=True)
class PlantNodeParameters(
    FrameSettings, IntegrationSettings, TickSettings, PaceSettings, ModelSettings, TripSettings
):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    command_timeout_s: float = parameter(
        3.0, "real_time: age in trip time beyond which a command is lost", "s", 0.1, 60.0
    )
    command_timeout_wall_s: float = parameter(
        10.0,
        "lock_step: wall time without the awaited command that counts as loss",
        "s",
        0.1,
        3600.0,
    )
    on_lost_controller: str = parameter(
        STOP,
        "lock_step, after command_timeout_wall_s: stop the vehicle and end at standstill, unless a "
        "controller answers before; or wait on for ever",
        choices=(STOP, WAIT),
    )
    expected_peers: int = parameter(
        1,
        "subscribers of plant/odometry and of clock to wait for before the start, 0 for none",
        "",
        0,
        100,
    )
    start_paused: bool = parameter(
        default=False, description="pause at the first state, until the service plant/resume"
    )
    at_end: str = parameter(
        EXIT,
        "when the trip has ended: end the process, or wait for the service plant/reset",
        choices=(EXIT, WAIT),
    )
    linger_s: float = parameter(
        1.0, "wall time between the last message and the end of the process", "s", 0.0, 60.0
    )

    def build_trip(self) -> Trip:
        """Return the trip, the vehicle at its start.

        Raises:
            IptmError: the parameter set, an override, the cycle or the slope is not usable.
        """
        model = self.model().values
        route = self.trip_route(model.gap.initial_gap_m)
        plant = Plant(model, route.slope.slope_at, self.integration_step_s, self.thermal_model)
        trip = Trip(plant, route.duration_s, self.period_s)
        trip.warm_up()
        return trip

"""Parameters of the plant node and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.override_text import parse_overrides
from iptm_core.routes import SLOPE_CHOICES, build_route
from iptm_interfaces.parameters import parameter
from iptm_plant_sim.plant import DEFAULT_STEP_S, Plant
from iptm_plant_sim.trip import Trip

LOCK_STEP = "lock_step"
REAL_TIME = "real_time"
STOP = "stop"
WAIT = "wait"


@dataclass(frozen=True)
class PlantNodeParameters:
    """Parameters of the node; ranges and units are in the declarations."""

    cycle: str = parameter(
        "wltc_class3b", "driving cycle that the road belongs to: a name, or the path of a .csv file"
    )
    slope: str = parameter("as_designed", "slope of the road", choices=SLOPE_CHOICES)
    duration_s: float = parameter(0.0, "length of the trip, 0 for the whole cycle", "s", 0.0, 1e6)
    parameter_set: str = parameter(
        DEFAULT_SET, "parameters of the vehicle: name of a shipped set, or the path of a .yaml file"
    )
    parameter_overrides: str = parameter(
        "", "single model parameters to change, e.g. 'body.mass_kg=1600, gap.max_gap_m=80'"
    )
    mode: str = parameter(
        LOCK_STEP,
        "lock_step waits for the command of each tick, real_time follows the wall clock",
        choices=(LOCK_STEP, REAL_TIME),
    )
    period_s: float = parameter(1.0, "trip time between two states", "s", 0.01, 10.0)
    integration_step_s: float = parameter(
        DEFAULT_STEP_S, "longest integration step inside a period", "s", 1e-3, 1.0
    )
    rate_factor: float = parameter(
        1.0, "real_time: seconds of trip time per second of wall time", "", 0.01, 1000.0
    )
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
        "lock_step: stop the vehicle and end, or wait on (to debug a controller)",
        choices=(STOP, WAIT),
    )
    expected_peers: int = parameter(
        1,
        "subscribers of plant/odometry and of /clock to wait for before the start, 0 for none",
        "",
        0,
        100,
    )
    linger_s: float = parameter(
        1.0, "wall time between the last message and the end of the process", "s", 0.0, 60.0
    )

    def build_trip(self) -> Trip:
        """Return the trip, the vehicle at its start.

        Raises:
            IptmError: the parameter set, an override, the cycle or the slope is not usable.
        """
        overrides = parse_overrides(self.parameter_overrides)
        model = load_parameters(self.parameter_set, overrides).values
        route = build_route(
            self.cycle,
            self.slope,
            initial_gap_m=model.gap.initial_gap_m,
            duration_s=self.duration_s or None,
        )
        plant = Plant(model, route.slope.slope_at, self.integration_step_s)
        trip = Trip(plant, route.duration_s, self.period_s)
        trip.warm_up()
        return trip

"""Settings that several parts of the suite share; each is declared here and nowhere else.

The groups of a trip and the parameters of nodes are composed of them by inheritance, because parameters of
nodes have flat names.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ParameterError
from iptm_core.parameters import DEFAULT_SET, ParameterSet, load_parameters
from iptm_core.parameters.loading import parse_overrides
from iptm_core.routes import SLOPE_CHOICES, Route, build_route
from iptm_core.routes.route import GPX_SUFFIX, USER_FILES
from iptm_core.state import NS_PER_S

MAX_SEED = 2**63 - 1
VEHICLE_LENGTH_M = 4.5
"""Default length from front to rear bumper: a compact car."""
VEHICLE_LENGTHS_M = (0.1, 102.0)
"""Shortest and longest vehicle, in the range of messages between vehicles."""


class LoopMode(TextEnum):
    """What trip time follows."""

    LOCK_STEP = "lock_step"
    """The command of each tick: as fast as the machine can, and exactly repeatable."""
    REAL_TIME = "real_time"
    """The wall clock."""


class PreviewMode(TextEnum):
    """Preview of the leader's motion that the ego vehicle receives."""

    FULL = "full"
    NONE = "none"


class LeaderSource(TextEnum):
    """Where the bridge gets the lead vehicle from."""

    CYCLE = "cycle"
    """The cycle itself."""
    CAM = "cam"
    """Cooperative awareness messages that arrive at a UDP port."""
    VEHICLE = "vehicle"
    """The odometry and the plans of another vehicle of the graph."""
    RANGE_SENSOR = "range_sensor"
    """The tracks of a range sensor; nothing is known of the future of the vehicle ahead."""
    RANGE_SENSOR_AND_CAM = "range_sensor_and_cam"
    """Gap and speed by the range sensor, the future by messages, each checked by the other."""
    NONE = "none"
    """No lead vehicle: the ego vehicle drives the road of the cycle at its limits."""


class ThermalModel(TextEnum):
    """Which cells of a coolant channel the simulated vehicle has."""

    TWO_CELL = "two_cell"
    """The first and the last one; the others lie evenly between them."""
    FULL_CHANNEL = "full_channel"
    """All of them. Other nodes receive the first and the last one."""


@dataclass(frozen=True)
class RoadSettings(Settings):
    """Leader and road."""

    cycle: str = parameter(
        "wltc_class3b",
        f"driving cycle of the leader: a name, or the path of a drive ({USER_FILES})",
    )
    slope: str = parameter(
        "as_designed",
        "slope of the road; a track, recorded or planned without times, is the road that the cycle "
        "is driven on",
        choices=SLOPE_CHOICES,
        suffixes=(GPX_SUFFIX,),
    )

    smooth_s: float = parameter(
        0.0,
        "width of the window over which the speeds of the leader's drive are averaged, 0 for none",
        "s",
        0.0,
        60.0,
    )

    def route(self, initial_gap_m: float, duration_s: float = 0.0) -> Route:
        """Build the route; a duration of 0 s is the whole cycle."""
        return build_route(
            self.cycle,
            self.slope,
            initial_gap_m=initial_gap_m,
            duration_s=duration_s or None,
            smooth_s=self.smooth_s,
        )


@dataclass(frozen=True)
class TripSettings(RoadSettings):
    """Leader, road and length of the trip."""

    duration_s: float = parameter(0.0, "length of the trip, 0 for the whole cycle", "s", 0.0, 1e6)

    def trip_route(self, initial_gap_m: float) -> Route:
        """Build the route of the trip; see `RoadSettings.route`."""
        return self.route(initial_gap_m, self.duration_s)


@dataclass(frozen=True)
class ModelSettings(Settings):
    """Parameters of vehicle, battery and cooling."""

    parameter_set: str = parameter(
        DEFAULT_SET, "parameters of the vehicle: name of a shipped set, or the path of a .yaml file"
    )
    overrides: str = parameter(
        "", "single model parameters to change, e.g. 'body.mass_kg=1600, gap.max_gap_m=80'"
    )

    def model(self) -> ParameterSet:
        """Load the parameters of the model.

        Raises:
            ParameterError: they cannot be read, have a chiller without a gate, or let the coolant freeze.
        """
        model = load_parameters(self.parameter_set, parse_overrides(self.overrides))
        # The physics take a moment to load, and most that has settings has no model.
        from iptm_core.physics.thermal_loop import refuse_freezing_coolant  # noqa: PLC0415

        refuse_freezing_coolant(model.values, f"parameter set {model.name}")
        if model.values.chiller.gate_power_w == 0.0:
            raise ParameterError(
                f"parameter set {model.name}: chiller.gate_power_w is 0, a chiller that cools with the "
                "compressor off; allowed: above 0 W in nodes and demos, 0 for trips in memory that reproduce "
                "the paper"
            )
        return model


MOST_PREVIEW_STEPS = 3600
"""Of a prediction: an hour in steps of 1 s. A message with more is refused before it is decoded."""


@dataclass(frozen=True)
class PreviewSettings(Settings):
    """Preview of the leader's motion that the ego vehicle receives, and its imperfections."""

    preview_mode: PreviewMode = parameter(
        PreviewMode.FULL, "preview of the leader's motion that the ego vehicle receives"
    )
    preview_length_s: float = parameter(
        60.0, "how far a prediction of the leader reaches", "s", 1.0, 3600.0
    )
    preview_step_s: float = parameter(
        1.0, "time between the nodes of a prediction", "s", 0.01, 3600.0
    )
    latency_s: float = parameter(
        0.0, "delay from generation to reception of a prediction", "s", 0.0, 3600.0
    )
    dropout_probability: float = parameter(0.0, "share of the predictions lost", "", 0.0, 1.0)
    dropout_burst: int = parameter(1, "predictions lost in a row by one disturbance", "", 1, 1000)
    noise_std_m_s: float = parameter(
        0.0, "standard deviation of the predicted speed, far ahead", "m/s", 0.0, 20.0
    )
    noise_correlation_s: float = parameter(
        10.0, "correlation time of the speed error along a prediction", "s", 0.1, 3600.0
    )
    seed: int = parameter(0, "seed of loss and error of the predictions", "", 0, MAX_SEED)

    def __post_init__(self) -> None:
        super().__post_init__()
        # A trip may leave the length open.
        if self.preview_length_s is not None:
            self._check_steps()

    def _check_steps(self) -> None:
        length_s = self.preview_length_s
        least_s = length_s / MOST_PREVIEW_STEPS
        if not least_s <= self.preview_step_s <= length_s:
            raise ParameterError(
                f"preview_step_s is {self.preview_step_s} s; allowed: {least_s:g} s, for at most "
                f"{MOST_PREVIEW_STEPS} steps, up to preview_length_s, {length_s:g} s"
            )


@dataclass(frozen=True)
class PaceSettings(Settings):
    """How fast trip time runs."""

    mode: LoopMode = parameter(
        LoopMode.LOCK_STEP,
        "lock_step waits for the command of each tick, real_time follows the wall clock",
    )
    rate_factor: float = parameter(
        1.0, "real_time: seconds of trip time per second of wall time", "", 0.01, 1000.0
    )
    pace: float = parameter(
        0.0,
        "lock_step: seconds of trip time per second of wall time at most, to be watched; 0 for no limit",
        "",
        0.0,
        1000.0,
    )


@dataclass(frozen=True)
class SamplingSettings(Settings):
    """Sampling time of the loop."""

    period_s: float = parameter(
        1.0, "sampling time of the loop, trip time between two states", "s", 1e-3, 10.0
    )


@dataclass(frozen=True)
class ClockSettings(Settings):
    """How often the time of the trip is published."""

    clock_hz: float = parameter(
        0.0,
        "real_time: clock messages per second of wall time, for nodes with timers on trip time, on top "
        "of one per tick; 0 for those alone; plant, bridge and sender need the same",
        "Hz",
        0.0,
        1000.0,
    )


@dataclass(frozen=True)
class TickSettings(ClockSettings, SamplingSettings):
    """Ticks, and the times published between them."""

    def is_tick(self, time_ns: int) -> bool:
        """Return whether a trip time (ns) of the clock is a tick, which is to be answered."""
        return self.clock_hz == 0.0 or time_ns % round(self.period_s * NS_PER_S) == 0


@dataclass(frozen=True)
class FrameSettings(Settings):
    """Names of a vehicle's frames."""

    frame_prefix: str = parameter(
        "",
        "prefix of the frames of this vehicle, car_1 for car_1/base_link; empty takes the namespace, / none",
    )


@dataclass(frozen=True)
class VehicleAheadSettings(Settings):
    """The vehicle ahead in a string of vehicles of the same graph; they drive in lock-step."""

    vehicle_ahead: str = parameter(
        "", "namespace of the vehicle ahead in a string of vehicles, e.g. /car_1; empty for none"
    )


@dataclass(frozen=True)
class IntegrationSettings(Settings):
    """Detail and accuracy of the simulated vehicle."""

    thermal_model: ThermalModel = parameter(
        ThermalModel.TWO_CELL,
        "cells of a coolant channel that are simulated: the first and the last one, or all of them",
    )

    integration_step_s: float = parameter(
        0.05, "longest integration step inside a period", "s", 1e-3, 10.0
    )


@dataclass(frozen=True)
class VehicleSettings(SafetyMonitorSettings, IntegrationSettings, ModelSettings):
    """The simulated vehicle, and where it starts."""

    plant: str = parameter(
        "",
        "file of a vehicle that an extra drives, such as car.fmu; empty for the suite's own model",
    )
    start_position_m: float = parameter(
        0.0, "where the front bumper is at the start, along the road", "m", -1e5, 1e5
    )
    vehicle_behind: str = parameter(
        "", "namespace of the vehicle behind in a string of vehicles, e.g. /car_3; empty for none"
    )


class LostController(TextEnum):
    """What the plant does in lock-step when an awaited command is lost."""

    STOP = "stop"
    """Stop the vehicle and end at standstill, unless a controller answers before."""
    WAIT = "wait"
    """Wait on for ever."""


@dataclass(frozen=True)
class LostControllerSettings(Settings):
    """When a command counts as lost, and what happens then."""

    command_timeout_s: float = parameter(
        3.0, "real_time: age in trip time beyond which a command is lost", "s", 0.1, 60.0
    )
    command_timeout_wall_s: float = parameter(
        10.0,
        "lock_step: wall time without the awaited command after which it counts as lost",
        "s",
        0.1,
        3600.0,
    )
    on_lost_controller: LostController = parameter(
        LostController.STOP,
        "lock_step, after command_timeout_wall_s: stop the vehicle and end at standstill, unless a "
        "controller answers before; or wait on for ever",
    )

"""A planned run: what it is made of, as data; and its parts, built before any process starts.

Every field of `Scenario` that is a declared parameter is also an option of the command line and a key of
scenario files; `parameter_specs(Scenario)` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MappingProxyType

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from iptm.faults.fault import Fault
from iptm.faults.injection import check_empty_road
from iptm_controller.horizon import Horizon
from iptm_controller.settings import ControllerSettings
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.declaration import (
    Scalar,
    Settings,
    checked_value,
    given_settings,
    parameter,
    parameter_specs,
    plain,
)
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import ParameterSet
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.routes import Route
from iptm_core.settings import (
    ClockSettings,
    FrameSettings,
    LoopMode,
    ModelSettings,
    PaceSettings,
    PreviewSettings,
    RangeSensorSettings,
    SafetyMonitorSettings,
    SamplingSettings,
    TripSettings,
)
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT
from iptm_v2x_bridge.rules_of_the_road import given_rules

AUTOMATIC_DOMAIN = -1
MAX_DOMAIN = 232

SETTINGS_OF_NODES: Mapping[str, tuple[type[Settings], ...]] = {
    PLANT: (
        TripSettings,
        ModelSettings,
        PaceSettings,
        ClockSettings,
        FrameSettings,
        SafetyMonitorSettings,
    ),
    BRIDGE: (
        TripSettings,
        RoadAheadSettings,
        ModelSettings,
        PreviewSettings,
        ClockSettings,
        FrameSettings,
        RangeSensorSettings,
    ),
    CONTROLLER: (
        ControllerSettings,
        AgingSettings,
        ChargingStopSettings,
        ModelSettings,
        FrameSettings,
    ),
}
"""Which settings of a scenario each node of the loop takes, as parameters of the same names."""

NODES = tuple(SETTINGS_OF_NODES)
"""Names of the nodes of the loop; extra parameters in a scenario are grouped by them."""

_IN_HEADING = ("cycle", "slope", "duration_s", "strategy", "horizon", "solver", "mode")
_NOT_CHANGES = frozenset((*_IN_HEADING, "overrides", "namespace", "domain"))
"""Settings of a scenario that its heading shows otherwise, or that do not change what is driven."""

_NO_PARAMETERS: Mapping[str, Mapping[str, Scalar]] = MappingProxyType({})


@dataclass(frozen=True)
class Scenario(
    SafetyMonitorSettings,
    FrameSettings,
    ClockSettings,
    PaceSettings,
    PreviewSettings,
    ControllerSettings,
    ModelSettings,
    RoadAheadSettings,
    TripSettings,
):
    """Route, vehicle, controller and conditions of a run; ranges and units are in the declarations.

    Attributes:
        name: short name, also that of the run's folder.
        description: one line for lists.
        node_parameters: further parameters by node (one of `NODES`) and name; the nodes check them.
        faults: what goes wrong, in the order of their beginning.
        foreign: nodes that the user starts.
    """

    name: str = "custom"
    description: str = ""
    namespace: str = parameter("", "namespace of all nodes, e.g. car_1; empty for none")
    domain: int = parameter(
        AUTOMATIC_DOMAIN,
        "ROS domain of the run; -1 takes ROS_DOMAIN_ID, or a free one where that is not set",
        "",
        AUTOMATIC_DOMAIN,
        MAX_DOMAIN,
    )
    node_parameters: Mapping[str, Mapping[str, Scalar]] = field(
        default_factory=lambda: _NO_PARAMETERS
    )
    faults: tuple[Fault, ...] = ()
    foreign: frozenset[str] = frozenset()

    @cached_property
    def vehicle(self) -> ParameterSet:
        """Parameters of vehicle, battery and cooling."""
        return self.model()

    @cached_property
    def trip(self) -> Route:
        """Leader, road and length of the trip."""
        return self.trip_route(self.vehicle.values.gap.initial_gap_m)

    @property
    def full_namespace(self) -> str:
        """Namespace as ROS writes it, with a leading slash; ``/`` for none."""
        return "/" + self.namespace.strip("/")

    @property
    def heading(self) -> str:
        """What was driven, in one line: name, trip, strategy, and every setting that is not a default."""
        horizon = Horizon.parse(self.horizon)
        strategy = f"strategy {self.strategy}, horizon {horizon}, {self.solver}"
        parts = [
            f"{self.name}: {self.trip.name}, {self.trip.duration_s:g} s",
            *([] if CONTROLLER in self.foreign else [strategy]),
            *(f"own {node}" for node in NODES if node in self.foreign),
            self.mode.value.replace("_", "-"),
            *self._changes(),
        ]
        return ", ".join(parts)

    def _changes(self) -> list[str]:
        """Return the non-default settings that do not appear elsewhere in the heading."""
        changes = [
            f"{spec.name}={plain(getattr(self, spec.name))}"
            for spec in parameter_specs(Scenario)
            if spec.name not in _NOT_CHANGES and getattr(self, spec.name) != spec.default
        ]
        changes += filter(None, [self.overrides])
        for node, values in self.node_parameters.items():
            changes += [f"{node}.{name}={value}" for name, value in values.items()]
        if self.faults:
            changes.append(f"{len(self.faults)} faults")
        return changes

    @property
    def road(self) -> RoadAheadSettings:
        """Lead vehicle and rules of the road, as the bridge is given them."""
        given = self.node_parameters.get(BRIDGE, {})
        return given_settings(RoadAheadSettings, {**vars(self), **given})

    @property
    def is_lock_step(self) -> bool:
        """Whether trip time waits for the controller."""
        return self.mode is LoopMode.LOCK_STEP


def names_for(node: str) -> tuple[str, ...]:
    """Return the settings of a scenario that a node takes."""
    return tuple(spec.name for group in SETTINGS_OF_NODES[node] for spec in parameter_specs(group))


def prepare(scenario: Scenario) -> Scenario:
    """Build the parts of a scenario, so that they are known to be sound, and return it.

    Raises:
        ScenarioError: a part cannot be built: unknown cycle, malformed horizon, contradictory
            parameters, periods or namespace.
    """

    def part(keys: str, build: Callable[[], object]) -> None:
        try:
            build()
        except IptmError as error:
            raise ScenarioError(f"scenario {scenario.name}: {keys}: {error}") from None

    part("parameter_set, overrides", lambda: scenario.vehicle)
    part("cycle, slope", lambda: scenario.trip)
    part("horizon", lambda: Horizon.parse(scenario.horizon))
    part("namespace", partial(_check_namespace, scenario.full_namespace))
    part("node_parameters", partial(_check_periods, scenario))
    part("node_parameters", lambda: scenario.road)
    part("speed_limits_km_h, signals", lambda: given_rules(scenario.road, scenario.trip))
    part("faults", partial(check_empty_road, scenario.road.leader_source, scenario.faults))
    return scenario


def _check_periods(scenario: Scenario) -> None:
    (spec,) = parameter_specs(SamplingSettings)
    given = scenario.node_parameters
    # The bridge needs the period to separate ticks from the clocks between them.
    others = (CONTROLLER, BRIDGE) if scenario.clock_hz > 0.0 else (CONTROLLER,)
    plant, *periods = (
        checked_value(spec, given.get(node, {}).get(spec.name, spec.default))
        for node in (PLANT, *others)
    )
    for node, period in zip(others, periods, strict=True):
        if plant != period:
            raise ScenarioError(
                f"{spec.name} is {plant:g} s for {PLANT} and {period:g} s for {node}; "
                "allowed: the same for both"
            )


def _check_namespace(namespace: str) -> None:
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        reason = " ".join(str(error).split("\n")[0].split())
        raise ScenarioError(
            f"{reason}; allowed: letters, digits and _, parts joined by /"
        ) from None

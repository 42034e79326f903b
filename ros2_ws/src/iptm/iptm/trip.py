"""A trip as data: five groups of settings, each setting with one name.

    trip = Trip.of("us06", slope="small", strategy="aging", latency_s=0.5)
    trip.leader.latency_s

The same names are keys of YAML files (`iptm.trip_files`), options ``--set group.name=value`` and parameters
of the nodes (`iptm.trip_settings`). `iptm.drive` drives a trip in memory or over ROS 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

from iptm.faults.fault import check_empty_road
from iptm.own_settings import flat_settings
from iptm.trip_settings import (
    CONTROLLER,
    HOME,
    NODES,
    SHARED,
    SPECS,
    Conditions,
    Control,
    EgoVehicle,
    Leader,
    Road,
    default_of,
    overrides_text,
)
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import FROM_STRATEGY
from iptm_controller.strategy import COST_TERMS
from iptm_core.declaration import Scalar, parameter_specs, plain
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import ModelParameters, ParameterSet, load_parameters
from iptm_core.parameters.loading import belonging_notes, parse_overrides
from iptm_core.physics.thermal_loop import refuse_freezing_coolant
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.routes import Route, build_route
from iptm_core.routes.comprehensive import RouteComposition
from iptm_core.routes.user_trip import UserTrip
from iptm_core.settings import LeaderSource, LoopMode, PreviewSettings, TripSettings
from iptm_core.user_input import check_known
from iptm_v2x_bridge.rules_of_the_road import given_rules

NO_COMPARISON = "none"
"""Stands for a strategy to compare with."""
SHORTEST_PREVIEW_S = 60.0
PREVIEW_RESERVE_S = 30.0
LONGEST_SETTING = 100
MOST_NAMED = 4
"""Overrides that a heading lists; of more, as of a vehicle of one's own, it has the number."""
_OWN = ("name", "description", "own_drive", "foreign")
_IN_HEADING = ("cycle", "slope", "duration_s", "strategy", "horizon", "namespace", "domain", "pace")
"""Settings that the heading of a trip shows otherwise, or that do not change the drive."""


@dataclass(frozen=True)
class Trip:
    """Everything that is chosen about a trip; `Trip.of` takes it as flat names.

    Attributes:
        name: short name, also of the folder of a run.
        description: one line for lists.
        own_drive: what the leader drives where the cycle is but a name.
        foreign: nodes of the loop that the user starts, over ROS 2.

    Raises:
        IptmError: settings of several groups contradict each other.
    """

    road: Road = field(default_factory=Road)
    leader: Leader = field(default_factory=Leader)
    vehicle: EgoVehicle = field(default_factory=EgoVehicle)
    controller: Control = field(default_factory=Control)
    conditions: Conditions = field(default_factory=Conditions)
    name: str = "custom"
    description: str = ""
    own_drive: UserTrip | RouteComposition | None = field(default=None, compare=False)
    foreign: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        unverified = (
            self.leader.leader_source is LeaderSource.CAM and not self.leader.refuse_unverified
        )
        if unverified and self.vehicle.authenticated_radio:
            # Any sender in range could otherwise brake the vehicle fully.
            object.__setattr__(self, "vehicle", replace(self.vehicle, authenticated_radio=False))
        shared: dict[str, Any] = {name: getattr(self.group_of(name), name) for name in SHARED}
        object.__setattr__(self, "controller", replace(self.controller, **shared))
        check_empty_road(self.rules.leader_source, self.conditions.faults)

    @classmethod
    def of(cls, cycle: Any = TripSettings.cycle, **settings: Any) -> Trip:
        """Return a trip with some settings, by their flat names; all others are defaults.

        Raises:
            IptmError: a name is unknown, or a value not allowed.
        """
        return cls().changed(cycle=cycle, **settings)

    def changed(self, **settings: Any) -> Trip:
        """Return this trip with other settings; None stands for a default.

        Args:
            settings: by their flat names, and objects in their place, see `iptm.own_settings`; in addition
                ``climate``, by name (its warmest month), an `iptm.Climate` or a temperature in degC, which
                sets what depends on the air; overrides in the same call come after it.

        Raises:
            IptmError: a name is unknown, or a value not allowed.
        """
        climate = settings.pop("climate", None)
        groups: dict[str, dict[str, Any]] = {}
        flat: dict[str, Any] = {"own_drive": None} if "cycle" in settings else {}
        flat |= flat_settings(settings)
        own: dict[str, Any] = {name: flat.pop(name) for name in _OWN if name in flat}
        for name, value in flat.items():
            check_known(name, HOME, "trip", error=ScenarioError)
            group = groups.setdefault(HOME[name], {})
            group[name] = default_of(name) if value is None else value
        changed: dict[str, Any] = {
            name: replace(getattr(self, name), **each) for name, each in groups.items()
        }
        trip = replace(self, **changed, **own)
        if climate is None:
            return trip
        from iptm.climate import air_overrides  # noqa: PLC0415  few trips state one

        before = parse_overrides(trip.vehicle.overrides)
        given = parse_overrides(overrides_text(flat.get("overrides") or {}))
        air = air_overrides(climate, trip.vehicle.parameter_set)
        return trip.changed(overrides={**before, **air, **given})

    @property
    def settings(self) -> dict[str, Scalar]:
        """All settings by name, as files hold them; with the length of the preview, without faults."""
        values = {name: plain(getattr(self.group_of(name), name)) for name in SPECS}
        return values | {"preview_length_s": self.preview.preview_length_s}

    def group_of(self, name: str) -> Any:
        """Return the group of a setting."""
        return getattr(self, HOME[name])

    @cached_property
    def model(self) -> ParameterSet:
        """Parameters of vehicle, battery and cooling, with their sources."""
        return _model(self.vehicle.parameter_set, self.vehicle.overrides)

    @property
    def parameters(self) -> ModelParameters:
        """Values of `model`."""
        return self.model.values

    @cached_property
    def controller_parameters(self) -> ModelParameters:
        """Parameters of the controller's model."""
        return _model(self.vehicle.parameter_set, self.controller_model_overrides).values

    @property
    def controller_model_overrides(self) -> str:
        """Overrides of the controller's model: the vehicle's and its own."""
        own = parse_overrides(self.controller.controller_overrides)
        return overrides_text({**parse_overrides(self.vehicle.overrides), **own})

    @property
    def notes(self) -> tuple[str, ...]:
        """Repairs of the drive, and parameters that were changed without their neighbours."""
        return (*self.route.notes, *belonging_notes(self.model))

    @cached_property
    def route(self) -> Route:
        """Leader, road and length of the trip."""
        road, gap_m = self.road, self.parameters.gap.initial_gap_m
        if self.own_drive is None:
            return _route(road.cycle, road.slope, gap_m, road.duration_s, road.smooth_s)
        return build_route(
            self.own_drive,
            road.slope,
            initial_gap_m=gap_m,
            duration_s=road.duration_s or None,
            smooth_s=road.smooth_s,
        )

    @cached_property
    def rules(self) -> RoadAheadSettings:
        """Lead vehicle and rules of the road."""
        both = {**vars(self.road), "leader_source": self.leader.leader_source}
        return RoadAheadSettings(
            **{spec.name: both[spec.name] for spec in parameter_specs(RoadAheadSettings)}
        )

    @cached_property
    def preview(self) -> PreviewSettings:
        """Preview of the leader, its length included."""
        leader = self.leader
        length_s = leader.preview_length_s
        if length_s is None:
            horizon_s = Horizon.parse(self.controller.horizon).duration_s
            needed_s = math.ceil(horizon_s + leader.latency_s + PREVIEW_RESERVE_S)
            length_s = max(SHORTEST_PREVIEW_S, needed_s)
        given = {spec.name: getattr(leader, spec.name) for spec in parameter_specs(PreviewSettings)}
        return PreviewSettings(**{**given, "preview_length_s": length_s})

    @property
    def options(self) -> ControllerOptions:
        """What the controller is to do; with the end of the trip, as from navigation."""
        return self.controller.options(self.conditions.period_s, self.route.duration_s)

    @cached_property
    def ticks(self) -> int:
        """Number of decisions.

        Raises:
            ScenarioError: the trip is not a whole number of ticks.
        """
        duration_s, tick_s = self.route.duration_s, self.conditions.period_s
        ticks = duration_s / tick_s
        if abs(ticks - round(ticks)) > 1e-6 or round(ticks) < 1:
            raise ScenarioError(
                f"trip of {duration_s:g} s with ticks of {tick_s:g} s; "
                "allowed: a whole number of ticks, at least one"
            )
        return round(ticks)

    @property
    def full_namespace(self) -> str:
        """Namespace as ROS writes it, with a leading slash; ``/`` for none."""
        return "/" + self.conditions.namespace.strip("/")

    @property
    def is_lock_step(self) -> bool:
        """Whether trip time waits for the controller."""
        return self.conditions.mode is LoopMode.LOCK_STEP

    @property
    def title(self) -> str:
        """Name and heading, the name of a run."""
        return f"{self.name}: {self.heading}"

    @property
    def heading(self) -> str:
        """The drive in one line: drive, horizon, strategy, and every setting that is not a default."""
        own = [f"own {node}" for node in NODES if node in self.foreign]
        control = [self.controller.horizon, self.controller.strategy]
        parts = [
            f"{self.route.name}, {self.route.duration_s:g} s",
            *([] if CONTROLLER in self.foreign else control),
            *own,
            *self.changes(),
        ]
        return ", ".join(parts)

    def changes(self) -> list[str]:
        """Return the settings that are not defaults and no part of the rest of the heading."""
        changes = [
            f"{name}={_cut(str(plain(getattr(self.group_of(name), name))))}"
            for name, spec in SPECS.items()
            if name not in (*_IN_HEADING, "preview_length_s")
            and getattr(self.group_of(name), name) != spec.default
        ]
        if len(parse_overrides(self.vehicle.overrides)) > MOST_NAMED:
            several = f"{len(parse_overrides(self.vehicle.overrides))} overrides"
            changes = [several if each.startswith("overrides=") else each for each in changes]
        if self.leader.preview_length_s is not None:
            changes.append(f"preview_length_s={self.leader.preview_length_s:g}")
        return [*changes, *(fault.describe() for fault in self.conditions.faults)]

    def checked(self) -> Trip:
        """Build the parts of the trip, so that they are known to be sound, and return it.

        Raises:
            ScenarioError: a part cannot be built, or parts contradict each other.
        """
        for names, build in (
            ("parameter_set, overrides", lambda: (self.model, self.controller_parameters)),
            ("cycle, slope", lambda: self.route),
            ("duration_s, period_s", lambda: self.ticks),
            ("speed_limits_km_h, signals", lambda: given_rules(self.rules, self.route)),
        ):
            self._build(names, build)
        return self

    def _build(self, names: str, build: Callable[[], object]) -> None:
        try:
            build()
        except IptmError as error:
            raise ScenarioError(f"trip {self.name}: {names}: {error}") from None

    def against(self, strategy: str) -> Trip:
        """Return the trip to compare this one with: sound, by another strategy on the single horizon.

        A leader that is heard drives the cycle.
        """
        source = self.leader.leader_source
        is_heard = source not in {LeaderSource.CYCLE, LeaderSource.NONE}
        return self.changed(
            strategy=strategy,
            horizon=str(SINGLE_HORIZON),
            preview_length_s=self.preview.preview_length_s,
            leader_source=LeaderSource.CYCLE if is_heard else source,
            ego_keeps_rules=self.road.ego_keeps_rules and not is_heard,
            faults=(),
            foreign=frozenset(),
            reference_temperature_k=FROM_STRATEGY,
            **dict.fromkeys(COST_TERMS, FROM_STRATEGY),
        )


def _cut(text: str) -> str:
    """Return a setting as a heading shows it: of tables the beginning."""
    return text if len(text) <= LONGEST_SETTING else f"{text[:LONGEST_SETTING]}..."


@lru_cache(maxsize=256)
def _model(name: str, overrides: str) -> ParameterSet:
    loaded = load_parameters(name, parse_overrides(overrides))
    refuse_freezing_coolant(loaded.values, f"vehicle {loaded.name}")
    return loaded


@lru_cache(maxsize=32)
def _route(
    cycle: str, slope: str, initial_gap_m: float, duration_s: float, smooth_s: float
) -> Route:
    return build_route(
        cycle,
        slope,
        initial_gap_m=initial_gap_m,
        duration_s=duration_s or None,
        smooth_s=smooth_s,
    )

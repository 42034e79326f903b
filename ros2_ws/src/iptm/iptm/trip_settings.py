"""The settings of a trip in five groups, each setting with one name; and what each node takes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any

from iptm.faults.fault import Fault, in_order
from iptm_controller.arrival import ArrivalCost
from iptm_controller.horizon import Horizon
from iptm_controller.settings import ControllerSettings
from iptm_core.braking import RangeSensorSettings
from iptm_core.declaration import ParameterSpec, Settings, declared, parameter, parameter_specs
from iptm_core.errors import ParameterError
from iptm_core.parameters.loading import parse_overrides
from iptm_core.road_ahead import LeaderSourceSettings, RoadAheadSettings, RoadRuleSettings
from iptm_core.settings import (
    FrameSettings,
    LostControllerSettings,
    ModelSettings,
    PaceSettings,
    PreviewSettings,
    SamplingSettings,
    TickSettings,
    TripSettings,
    VehicleAheadSettings,
    VehicleSettings,
)
from iptm_core.user_input import shown
from iptm_v2x_bridge.settings import LeaderSettings

PLANT, BRIDGE, CONTROLLER = "plant", "v2x_bridge", "controller"
NODE_SETTINGS: Mapping[str, tuple[type[Settings], ...]] = {
    PLANT: (
        TripSettings,
        VehicleSettings,
        PaceSettings,
        TickSettings,
        FrameSettings,
        LostControllerSettings,
        VehicleAheadSettings,
        LeaderSourceSettings,
    ),
    BRIDGE: (
        TripSettings,
        RoadAheadSettings,
        LeaderSettings,
        ModelSettings,
        TickSettings,
        FrameSettings,
        RangeSensorSettings,
    ),
    CONTROLLER: (ControllerSettings, ModelSettings, SamplingSettings, FrameSettings),
}
"""Settings that each node of the loop takes, as parameters of the same names."""
NODES = tuple(NODE_SETTINGS)

AUTOMATIC_DOMAIN = -1
MAX_DOMAIN = 232
_FAULTS = "faults"


@dataclass(frozen=True)
class Road(RoadRuleSettings, TripSettings):
    """The drive, its road, and the rules of the road."""


@dataclass(frozen=True)
class Leader(LeaderSettings):
    """The lead vehicle, its messages, and the preview of its motion.

    A preview length of None covers the horizon and a reserve for the age of predictions, but at least a
    minute.
    """

    preview_length_s: float | None = declared(  # type: ignore[assignment]  # open, where wanted
        PreviewSettings, "preview_length_s", default=None
    )


@dataclass(frozen=True)
class EgoVehicle(VehicleSettings):
    """The ego vehicle; ``overrides`` is sorted and may be given as a mapping."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "overrides", overrides_text(self.overrides))
        super().__post_init__()


@dataclass(frozen=True)
class Control(ControllerSettings):
    """The controller, and where its model differs from the vehicle."""

    controller_overrides: str = parameter(
        "", "single parameters in which the model of the controller differs from the vehicle"
    )

    def __post_init__(self) -> None:
        text = overrides_text(self.controller_overrides)
        object.__setattr__(self, "controller_overrides", text)
        super().__post_init__()
        object.__setattr__(self, "horizon", str(Horizon.parse(self.horizon)))
        ArrivalCost.parse(self.arrival_cost_eur)


@dataclass(frozen=True)
class Conditions(LostControllerSettings, FrameSettings, TickSettings, PaceSettings):
    """Pace and sampling of the loop, where it runs, and what goes wrong.

    Attributes:
        faults: in the order of their beginning.
    """

    namespace: str = parameter("", "namespace of all nodes, e.g. car_1; empty for none")
    domain: int = parameter(
        AUTOMATIC_DOMAIN,
        "ROS domain of the run; -1 takes ROS_DOMAIN_ID, or a free one where that is not set",
        "",
        AUTOMATIC_DOMAIN,
        MAX_DOMAIN,
    )
    start_paused: bool = parameter(
        default=False, description="over ROS 2: begin with the service plant/resume"
    )
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        given: Any = self.faults
        is_list = isinstance(given, (tuple, list))
        if not is_list or not all(isinstance(each, Fault) for each in given):
            raise ParameterError(f"faults is {shown(given)}; allowed: a list of iptm.Fault")
        object.__setattr__(self, _FAULTS, in_order(given))


GROUPS: Mapping[str, type[Settings]] = {
    "road": Road,
    "leader": Leader,
    "vehicle": EgoVehicle,
    "controller": Control,
    "conditions": Conditions,
}
SPECS: Mapping[str, ParameterSpec] = {
    spec.name: spec for group in GROUPS.values() for spec in parameter_specs(group)
}
"""Declarations of all settings by name."""
HOME: Mapping[str, str] = {
    **{
        spec.name: name
        for name, group in reversed(list(GROUPS.items()))
        for spec in parameter_specs(group)
    },
    _FAULTS: "conditions",
}
"""Group of every setting; the controller takes what it shares with the vehicle from there."""
SHARED = tuple(spec.name for spec in parameter_specs(Control) if HOME[spec.name] != "controller")


def default_of(name: str) -> Any:
    """Return the default of a setting."""
    (found,) = (entry for entry in fields(GROUPS[HOME[name]]) if entry.name == name)
    return found.default


def overrides_text(given: Any) -> str:
    """Return overrides in one line, sorted; other things than a mapping or a text are left to the check."""
    overrides = parse_overrides(given) if isinstance(given, str) else given
    if not isinstance(overrides, Mapping):
        unchanged: str = given
        return unchanged
    for key, value in overrides.items():
        if isinstance(value, bool) or not isinstance(value, Real):
            raise ParameterError(f"{key} is {shown(value)}; allowed: a number")
    return ", ".join(f"{key}={float(value)!r}" for key, value in sorted(overrides.items()))

"""Everything that one run without ROS depends on, as data.

A specification names its inputs (a cycle, a parameter set); a ``study.Case`` looks up the numbers, and makes
of them the key under which the result is stored.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from enum import Enum
from typing import Any

from iptm.faults.fault import Fault, faults_from, in_order, plain_faults
from iptm.faults.injection import check_empty_road, check_headless
from iptm_controller.horizon import Horizon
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import Strategy, strategy_by_name
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.declaration import declared, parameter, parameter_specs
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import DEFAULT_SET
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.road_friction import RoadFrictionSettings
from iptm_core.settings import (
    IntegrationSettings,
    LeaderSource,
    ModelSettings,
    PreviewSettings,
    SamplingSettings,
    SensorAccuracySettings,
    ThermalModel,
    TripSettings,
)
from iptm_core.user_input import StrictMapping

REPRODUCED_CYCLE = "comprehensive_identified"
REPRODUCED_SET = "paper_identified"
"""Trip and parameter set of every case of a study that does not state its own: the reproduction is made with
them."""

SHORTEST_PREVIEW_S = 60.0
PREVIEW_RESERVE_S = 30.0
_OVERRIDES = ("overrides", "controller_overrides")


class RunKind(Enum):
    """What is done with the route."""

    CLOSED_LOOP = "closed_loop"
    """A controller drives it tick by tick."""
    WHOLE_TRIP = "whole_trip"
    """The whole trip is one optimal control problem; its inputs are driven on the plant."""


_PREVIEW = tuple(spec.name for spec in parameter_specs(PreviewSettings))
_SOLVER = {"name": "solver"} | {
    name: name for name in ("tolerance", "max_iterations", "compile_code", "smoothing_factor")
}
SECTIONS: dict[str, dict[str, str]] = {
    "solver": _SOLVER,
    "preview": {name.removeprefix("preview_"): name for name in _PREVIEW},
}
"""Groups of settings that files write as sections: name of the setting by key in the section."""
HEADLESS_LEADERS = (LeaderSource.CYCLE, LeaderSource.NONE)


@dataclass(frozen=True)
class RunSpec(
    RoadFrictionSettings,
    SensorAccuracySettings,
    RoadAheadSettings,
    AgingSettings,
    ChargingStopSettings,
    PreviewSettings,
):
    """One run; what studies choose otherwise than nodes and scenarios is stated as another default.

    The length of the preview may be left open (None): it is then that of the horizon and a reserve for the
    age of a prediction, but at least a minute. The settings of the solver have ranges for experiments.

    Attributes:
        cycle: driving cycle, by name or as the path of a drive.
        duration_s: length of the trip, None for the whole cycle.
        parameter_set: shipped set by name, or the path of a .yaml file.
        overrides: single parameters that differ, dotted key and value, sorted by key.
        controller_overrides: those in which the controller's model differs from the vehicle.
        strategy: cost terms and weights. Its name is a label only.
        horizon: prediction grid such as ``3x1+5x5``; of a whole trip, that of the run it starts from.
        faults: what goes wrong, in the order of their beginning.

    Raises:
        IptmError: a value is unknown or out of range.
    """

    kind: RunKind = parameter(RunKind.CLOSED_LOOP, "what is done with the route")
    cycle: str = declared(TripSettings, "cycle", default="comprehensive")
    slope: str = declared(TripSettings, "slope")
    duration_s: float | None = declared(TripSettings, "duration_s", default=None)
    parameter_set: str = declared(ModelSettings, "parameter_set")
    overrides: tuple[tuple[str, float], ...] = ()
    controller_overrides: tuple[tuple[str, float], ...] = ()
    strategy: Strategy = field(default_factory=lambda: strategy_by_name("aging"))
    horizon: str = declared(ControllerSettings, "horizon", default="15x1")
    preview_length_s: float | None = declared(  # type: ignore[assignment]  # open, where wanted
        PreviewSettings, "preview_length_s", default=None
    )
    solver: str = declared(ControllerSettings, "solver")
    tolerance: float = declared(ControllerSettings, "tolerance")
    max_iterations: int = declared(ControllerSettings, "max_iterations")
    compile_code: bool = declared(ControllerSettings, "compile_code")
    smoothing_factor: float = parameter(
        1.0, "factor on the widths of the smoothed kinks of the model", "", 0.01, 10.0
    )
    tick_s: float = declared(SamplingSettings, "period_s")
    plant_step_s: float = declared(IntegrationSettings, "integration_step_s")
    thermal_model: ThermalModel = declared(IntegrationSettings, "thermal_model")
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _OVERRIDES:
            object.__setattr__(self, name, tuple(sorted(getattr(self, name))))
        object.__setattr__(self, "horizon", str(Horizon.parse(self.horizon)))
        object.__setattr__(self, "faults", in_order(self.faults))
        check_headless(self.faults)
        self.bridge_settings()
        self._check_road()
        if self.strategy.is_rule_based and self.kind is RunKind.WHOLE_TRIP:
            raise ScenarioError(
                f"a whole trip with strategy '{self.strategy.name}', which optimises nothing; "
                "allowed: strategies with weights"
            )
        if self.duration_s is not None and self.duration_s < self.tick_s:
            raise ScenarioError(
                f"duration_s is {self.duration_s}; allowed: one tick, {self.tick_s:g} s, or more"
            )

    def _check_road(self) -> None:
        """Refuse what cannot happen without ROS, or on an empty road."""
        if self.leader_source not in HEADLESS_LEADERS:
            raise ScenarioError(
                f"leader_source is {self.leader_source}; allowed without ROS: "
                f"{', '.join(HEADLESS_LEADERS)}"
            )
        if self.kind is RunKind.WHOLE_TRIP and self.keeps_rules:
            raise ScenarioError(
                "a whole trip with rules of the road; allowed: closed loops, as it knows its leader only"
            )
        check_empty_road(self.leader_source, self.faults)

    @property
    def road(self) -> RoadAheadSettings:
        """Lead vehicle and rules of the road."""
        return RoadAheadSettings.of(self)

    def bridge_settings(self) -> PreviewSettings:
        """Settings of the bridge for this run's horizon."""
        settings = {name: getattr(self, name) for name in _PREVIEW}
        if self.preview_length_s is None:
            horizon_s = Horizon.parse(self.horizon).duration_s
            needed_s = math.ceil(horizon_s + self.latency_s + PREVIEW_RESERVE_S)
            settings["preview_length_s"] = max(SHORTEST_PREVIEW_S, needed_s)
        return PreviewSettings(**settings)

    @property
    def solver_settings(self) -> dict[str, Any]:
        """Solver of the controller and its settings."""
        return {name: getattr(self, attribute) for name, attribute in _SOLVER.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON; ``from_dict`` is the inverse."""
        content = asdict(self)
        content["kind"] = self.kind.value
        content["thermal_model"] = self.thermal_model.value
        content["leader_source"] = self.leader_source.value
        content |= {name: dict(getattr(self, name)) for name in _OVERRIDES}
        content["faults"] = plain_faults(self.faults)
        content["preview"] = {name: content.pop(name) for name in _PREVIEW}
        content["solver"] = {name: content.pop(attribute) for name, attribute in _SOLVER.items()}
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> RunSpec:
        """Rebuild a specification; a ScenarioError if it is not complete and correct."""
        grouped = {*_PREVIEW, *_SOLVER.values()}
        names = {*SECTIONS, *(entry.name for entry in fields(cls) if entry.name not in grouped)}
        try:
            written = StrictMapping(content, "run specification", sorted(names))
            written.require(*sorted(names))
            solver, preview = (
                written.section("solver", _SOLVER),
                written.section("preview", _PREVIEW),
            )
            return cls(
                **{
                    **{name: written.content[name] for name in names - {*SECTIONS}},
                    **{_SOLVER[name]: value for name, value in solver.content.items()},
                    **preview.content,
                    **{name: tuple(written.section(name).content.items()) for name in _OVERRIDES},
                    "faults": faults_from(written.content["faults"], written.where),
                    "strategy": Strategy(**written.section("strategy").content),
                }
            )
        except (TypeError, IptmError) as error:
            raise ScenarioError(f"run specification cannot be read: {error}") from error

    def with_strategy(self, strategy: Strategy) -> RunSpec:
        """The same run under another strategy."""
        return replace(self, strategy=strategy)

    def describe(self) -> str:
        """One line for people."""
        where = self.cycle if self.duration_s is None else f"{self.cycle} {self.duration_s:g} s"
        what = "whole trip" if self.kind is RunKind.WHOLE_TRIP else self.horizon
        parts = [where, what, self.strategy.name]
        if self.parameter_set != DEFAULT_SET:
            parts.append(self.parameter_set)
        if self.thermal_model is not ThermalModel.TWO_CELL:
            parts.append(str(self.thermal_model))
        parts += [f"{key}={value:g}" for key, value in self.overrides]
        parts += [f"controller {key}={value:g}" for key, value in self.controller_overrides]
        usual = {entry.name: entry.default for entry in fields(self)}
        for group in RunSpec.__bases__:
            for name in (spec.name for spec in parameter_specs(group)):
                if getattr(self, name) != usual[name]:
                    parts.append(f"{name}={getattr(self, name)}")
        parts += [fault.describe() for fault in self.faults]
        return ", ".join(parts)


def canonical_json(content: object) -> str:
    """JSON with sorted keys and without blanks: equal content gives equal text."""
    try:
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except ValueError as error:
        raise ScenarioError(
            f"a value is not a finite number; allowed: finite ones: {error}"
        ) from error

"""Everything that one run without ROS depends on, as data.

A specification names its inputs (a cycle, a parameter set); ``run_inputs`` turns the names into
numbers, and ``run_key`` those numbers into the key under which the result is stored.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from enum import Enum
from typing import Any

from iptm_controller.controller import ControllerOptions
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.factory import SOLVER_NAMES, SolverOptions
from iptm_controller.strategy import Strategy, strategy_by_name
from iptm_core.errors import ScenarioError
from iptm_core.parameters import DEFAULT_SET
from iptm_plant_sim.plant import DEFAULT_STEP_S
from iptm_v2x_bridge.bridge import BridgeSettings, PreviewMode
from iptm_v2x_bridge.imperfections import Imperfections
from iptm_v2x_bridge.source import PreviewGrid

SHORTEST_PREVIEW_S = 60.0
PREVIEW_RESERVE_S = 30.0
_SOLVER = SolverOptions()


class RunKind(Enum):
    """What is done with the route."""

    CLOSED_LOOP = "closed_loop"
    """A controller drives it tick by tick."""
    WHOLE_TRIP = "whole_trip"
    """The whole trip is one optimal control problem; its inputs are driven on the plant."""


@dataclass(frozen=True)
class SolverSpec:
    """Solver of the controller; the defaults are the controller's own."""

    name: str = _SOLVER.name
    tolerance: float = _SOLVER.tolerance
    max_iterations: int = _SOLVER.max_iterations

    def __post_init__(self) -> None:
        if self.name not in SOLVER_NAMES:
            raise ScenarioError(
                f"solver {self.name!r} is unknown; allowed are {', '.join(SOLVER_NAMES)}"
            )
        if not 0.0 < self.tolerance <= 1.0:
            raise ScenarioError(f"solver tolerance is {self.tolerance}; allowed: above 0 up to 1")
        if not 1 <= self.max_iterations <= 100_000:
            raise ScenarioError(
                f"solver max_iterations is {self.max_iterations}; allowed: 1 to 100000"
            )


@dataclass(frozen=True)
class PreviewSpec:
    """What the host is told about the leader's future.

    Attributes:
        mode: ``full`` or ``none``.
        length_s: how far a prediction reaches; None for the horizon and a reserve for its age, but at
            least a minute.
        step_s: time between the nodes of a prediction.
        latency_s: time from generation to reception.
        dropout_probability: share of the predictions that are lost.
        dropout_burst: number of successive predictions that one disturbance takes away.
        noise_std_m_s: standard deviation of the speed error far ahead.
        noise_correlation_s: time over which the speed error forgets its value.
        seed: of loss and noise.
    """

    mode: str = PreviewMode.FULL.value
    length_s: float | None = None
    step_s: float = 1.0
    latency_s: float = 0.0
    dropout_probability: float = 0.0
    dropout_burst: int = 1
    noise_std_m_s: float = 0.0
    noise_correlation_s: float = 10.0
    seed: int = 0

    def reach_s(self, horizon_s: float) -> float:
        """Length of the predictions for a horizon."""
        if self.length_s is not None:
            return self.length_s
        return max(SHORTEST_PREVIEW_S, math.ceil(horizon_s + self.latency_s + PREVIEW_RESERVE_S))

    def settings(self, horizon_s: float) -> BridgeSettings:
        """Settings of the bridge.

        Raises:
            ScenarioError: the mode is unknown.
            ParameterError: a value is out of range.
        """
        modes = [mode.value for mode in PreviewMode]
        if self.mode not in modes:
            raise ScenarioError(f"preview mode {self.mode!r}; allowed are {', '.join(modes)}")
        return BridgeSettings(
            mode=PreviewMode(self.mode),
            grid=PreviewGrid(self.reach_s(horizon_s), self.step_s),
            imperfections=Imperfections(
                latency_s=self.latency_s,
                dropout_probability=self.dropout_probability,
                dropout_burst=self.dropout_burst,
                noise_std_m_s=self.noise_std_m_s,
                noise_correlation_s=self.noise_correlation_s,
                seed=self.seed,
            ),
        )


@dataclass(frozen=True)
class RunSpec:
    """One run.

    Attributes:
        kind: closed loop or whole trip.
        cycle: driving cycle, by name or as the path of a .csv file.
        slope: slope choice of ``build_route``.
        duration_s: length of the trip, None for the whole cycle.
        parameter_set: shipped set by name, or the path of a .yaml file.
        overrides: single parameters that differ, dotted key and value, sorted by key.
        strategy: cost terms and weights. Its name is a label only.
        horizon: prediction grid such as ``3x1+5x5``; of a whole trip, that of the run it starts from.
        solver: solver of the controller.
        preview: predictions of the leader.
        tick_s: sampling time of the loop.
        plant_step_s: longest integration step of the plant.

    Raises:
        IptmError: a value is unknown or out of range.
    """

    kind: RunKind = RunKind.CLOSED_LOOP
    cycle: str = "comprehensive"
    slope: str = "as_designed"
    duration_s: float | None = None
    parameter_set: str = DEFAULT_SET
    overrides: tuple[tuple[str, float], ...] = ()
    strategy: Strategy = field(default_factory=lambda: strategy_by_name("aging"))
    horizon: str = "15x1"
    solver: SolverSpec = field(default_factory=SolverSpec)
    preview: PreviewSpec = field(default_factory=PreviewSpec)
    tick_s: float = ControllerOptions.tick_s
    plant_step_s: float = DEFAULT_STEP_S

    def __post_init__(self) -> None:
        object.__setattr__(self, "overrides", tuple(sorted(self.overrides)))
        object.__setattr__(self, "horizon", str(Horizon.parse(self.horizon)))
        self.bridge_settings()
        for name in ("tick_s", "plant_step_s"):
            value = getattr(self, name)
            if not 1e-3 <= value <= 10.0:
                raise ScenarioError(f"{name} is {value} s; allowed: 0.001 to 10")
        if self.duration_s is not None and not self.tick_s <= self.duration_s <= 1e6:
            raise ScenarioError(
                f"duration_s is {self.duration_s}; allowed: one tick, {self.tick_s:g}, to 1e6"
            )

    def bridge_settings(self) -> BridgeSettings:
        """Settings of the bridge for this run's horizon."""
        return self.preview.settings(Horizon.parse(self.horizon).duration_s)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON; ``from_dict`` is the inverse."""
        content = asdict(self)
        content["kind"] = self.kind.value
        content["overrides"] = dict(self.overrides)
        return content

    def to_json(self) -> str:
        """Canonical text: sorted keys, shortest floats that read back exactly."""
        return canonical_json(self.to_dict())

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> RunSpec:
        """Rebuild a specification.

        Raises:
            ScenarioError: keys are missing or unknown, or a value is not as it should be.
        """
        try:
            rest = {**content}
            return cls(
                kind=RunKind(rest.pop("kind")),
                overrides=tuple(rest.pop("overrides").items()),
                strategy=Strategy(**rest.pop("strategy")),
                solver=SolverSpec(**rest.pop("solver")),
                preview=PreviewSpec(**rest.pop("preview")),
                **rest,
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ScenarioError(
                f"run specification cannot be read ({error}); needed are "
                f"{', '.join(entry.name for entry in fields(cls))}"
            ) from error

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
        parts += [f"{key}={value:g}" for key, value in self.overrides]
        if self.preview != PreviewSpec():
            usual = asdict(PreviewSpec())
            parts += [
                f"{key}={value}"
                for key, value in asdict(self.preview).items()
                if value != usual[key]
            ]
        return ", ".join(parts)


def canonical_json(content: object) -> str:
    """JSON with sorted keys and without blanks: equal content gives equal text."""
    try:
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except ValueError as error:
        raise ScenarioError(
            f"a value is not a finite number; allowed are finite ones: {error}"
        ) from error

"""What is driven: cars, climates and gap limits, and what two sets of runs save against each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from iptm_controller.horizon import SINGLE_HORIZON
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.metrics import RunMetrics, at_equal_end
from iptm_core.parameters import DEFAULT_SET
from iptm_core.parameters.model import CELSIUS_ZERO_K, ModelParameters
from iptm_studies.run_spec import RunSpec, SolverSpec

DEFAULT, REFERENCE, PRODUCTION = "default", "reference", "production"
_CONTROLLER = ControllerSettings()
STRATEGIES = {
    DEFAULT: (_CONTROLLER.strategy, _CONTROLLER.horizon),
    REFERENCE: ("reference", str(SINGLE_HORIZON)),
    PRODUCTION: ("production", _CONTROLLER.horizon),
}
"""Strategy and grid by the role in the tables; the production-like one has no grid."""
ROLES = tuple(STRATEGIES)
CYCLE = "wltc_class3b"
CARS = (DEFAULT_SET, "bmw_i3", "chevrolet_bolt", "tesla_model_3")
CLIMATES_C = (-10.0, 10.0, 25.0, 35.0)
HEADWAY = "gap.max_time_headway_s"


@dataclass(frozen=True)
class Extent:
    """How much is driven.

    Attributes:
        trips: measured trips, as paths of drive files.
        cars: parameter sets.
        climates_c: temperatures of the air.
        simplifications: number of the simplifications that are tried.
        duration_s: where all trips are cut, None for their ends.
        compile_code: whether controllers are compiled.
    """

    trips: tuple[str, ...]
    cars: tuple[str, ...] = CARS
    climates_c: tuple[float, ...] = CLIMATES_C
    simplifications: int | None = None
    duration_s: float | None = None
    compile_code: bool = True

    @classmethod
    def short(cls, trips: Sequence[str]) -> Extent:
        """Return a little of everything, in seconds."""
        car, climate = CARS[1:2], CLIMATES_C[-1:]
        return cls(tuple(trips[:2]), car, climate, 1, 20.0, compile_code=False)

    def solver(self, smoothing_factor: float = 1.0) -> SolverSpec:
        """Return the solver of a run."""
        return SolverSpec(compile_code=self.compile_code, smoothing_factor=smoothing_factor)


def drive(
    role: str,
    car: str,
    ambient_c: float,
    *,
    cycle: str = CYCLE,
    overrides: dict[str, float] | None = None,
    **settings: Any,
) -> RunSpec:
    """Return a run of a car that was parked outside: the cells begin at the temperature of the air.

    Args:
        role: one of `ROLES`.
        car: name of its parameter set.
        ambient_c: temperature of the air in degC.
        cycle: driving cycle.
        overrides: further parameters that differ.
        settings: of the run, as in `RunSpec`.
    """
    strategy, horizon = STRATEGIES[role]
    ambient_k = ambient_c + CELSIUS_ZERO_K
    climate = {
        "environment.ambient_temperature_k": ambient_k,
        "environment.initial_cell_temperature_k": ambient_k,
    }
    return RunSpec(
        cycle=cycle,
        parameter_set=car,
        overrides=tuple({**climate, **(overrides or {})}.items()),
        strategy=strategy_by_name(strategy),
        horizon=horizon,
        **settings,
    )


@dataclass(frozen=True)
class Totals:
    """Sums over runs: capacity loss of both cells, energies in J, distance in m."""

    capacity_loss: float
    cooling_j: float
    traction_j: float
    battery_j: float
    distance_m: float

    @classmethod
    def of(cls, runs: Iterable[RunMetrics]) -> Totals:
        """Sum up runs."""
        rows = [
            (
                run.degradation.total,
                run.energy.cooling_j,
                run.energy.traction_j,
                run.energy.battery_j,
                run.distance_m,
            )
            for run in runs
        ]
        return cls(*(math.fsum(column) for column in zip(*rows, strict=True)))

    @property
    def consumption_kwh_100_km(self) -> float:
        """Battery energy per distance."""
        return self.battery_j / 3.6e6 / (self.distance_m / 1e5)


@dataclass(frozen=True)
class Saving:
    """What runs save against others of the same trips, in percent of those; negative where they need more.

    Attributes:
        aging: capacity lost by both cells.
        aging_at_equal_end: the same with both packs at the temperature of the cooler one; NaN where that is
            below the lower limit of the temperature.
        cooling: energy of compressor and auxiliaries.
        traction: electric traction energy.
        consumption: battery energy per distance.
    """

    aging: float
    aging_at_equal_end: float
    cooling: float
    traction: float
    consumption: float

    @classmethod
    def of(
        cls,
        own: list[RunMetrics],
        others: list[RunMetrics],
        parameters: ModelParameters,
    ) -> Saving:
        """Compare runs with others, in the same order of trips.

        Args:
            own: the runs.
            others: those they are compared with.
            parameters: of the vehicle.
        """
        mine, theirs = Totals.of(own), Totals.of(others)
        pairs = list(zip(own, others, strict=True))
        return cls(
            aging=_percent(mine.capacity_loss, theirs.capacity_loss),
            aging_at_equal_end=_at_equal_end(pairs, parameters),
            cooling=_percent(mine.cooling_j, theirs.cooling_j),
            traction=_percent(mine.traction_j, theirs.traction_j),
            consumption=_percent(mine.consumption_kwh_100_km, theirs.consumption_kwh_100_km),
        )


def _at_equal_end(pairs: list[tuple[RunMetrics, RunMetrics]], parameters: ModelParameters) -> float:
    coolest_k = parameters.limits.min_temperature_k
    own_loss = other_loss = 0.0
    for own, other in pairs:
        ends = at_equal_end(own, other, parameters)
        if ends is None or ends.temperature_k < coolest_k:
            return math.nan
        own_loss += ends.own.capacity_loss
        other_loss += ends.other.capacity_loss
    return _percent(own_loss, other_loss)


def _percent(own: float, other: float) -> float:
    return 100.0 * (1.0 - own / other)

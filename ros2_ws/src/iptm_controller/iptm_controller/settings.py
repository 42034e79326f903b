"""Settings of the controller: a group of a trip, and parameters of the controller node."""

from __future__ import annotations

import math
from dataclasses import dataclass, make_dataclass, replace
from typing import TYPE_CHECKING

from iptm_controller.arrival import ArrivalCost
from iptm_controller.estimator import NoiseSettings
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.production import ProductionSettings
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import (
    COST_TERMS,
    DEFAULT_STRATEGY,
    MAX_WEIGHT,
    STRATEGIES,
    Strategy,
    strategy_by_name,
)
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.braking import RadioSettings, RoadFrictionSettings, SensorAccuracySettings
from iptm_core.declaration import Settings, parameter
from iptm_core.metrics.constraints import Concern

_SOLVER = SolverOptions()
FROM_STRATEGY = -1.0

if TYPE_CHECKING:

    class WeightSettings(Settings):
        """One parameter for the weight of every cost term."""

else:
    WeightSettings = make_dataclass(
        "WeightSettings",
        [
            (
                key,
                "float",
                parameter(
                    FROM_STRATEGY,
                    f"{term.symbol}, weight of {term.name}: {term.meaning}; -1: as in the strategy",
                    term.unit,
                    -1.0,
                    MAX_WEIGHT,
                ),
            )
            for key, term in COST_TERMS.items()
        ],
        bases=(Settings,),
        frozen=True,
    )


@dataclass(frozen=True)
class WarningSettings(Settings):
    """Times after which a situation causes a warning."""

    motion_warning_s: float = parameter(
        10.0, "warn when gap or speed are measured out of limits for longer", "s", 0.0, 3600.0
    )
    temperature_warning_s: float = parameter(
        60.0, "warn when a cell is measured above its limit for longer", "s", 0.0, 36000.0
    )
    cooling_warning_s: float = parameter(
        60.0,
        "warn when the compressor is at its limit for longer and the warmest cell, above its limit, "
        "does not get colder",
        "s",
        0.0,
        36000.0,
    )
    plan_warning_s: float = parameter(
        60.0, "warn when plans end out of limits for longer", "s", 0.0, 36000.0
    )

    def after_s(self, concern: Concern) -> float:
        """Return the time after which a concern causes a warning, in s."""
        times = {
            Concern.HOT_CELL: self.temperature_warning_s,
            Concern.COOLING: self.cooling_warning_s,
            Concern.PLAN: self.plan_warning_s,
        }
        return times.get(concern, self.motion_warning_s)


@dataclass(frozen=True)
class ControllerSettings(
    WeightSettings,
    NoiseSettings,
    RoadFrictionSettings,
    SensorAccuracySettings,
    RadioSettings,
    WarningSettings,
    AgingSettings,
    ProductionSettings,
):
    """What the controller optimises, how far ahead, and what it does without a solution."""

    strategy: str = parameter(DEFAULT_STRATEGY, "cost terms and weights", choices=tuple(STRATEGIES))
    horizon: str = parameter(
        str(MULTI_HORIZON),
        "prediction grid, <steps>x<seconds> parts joined by +, thermal ones with a t behind",
    )
    reference_temperature_k: float = parameter(
        FROM_STRATEGY,
        "r_T, temperature that J2 measures deviations from; -1: as in the strategy",
        "K",
        -1.0,
        400.0,
    )
    value_beyond_trip: bool = parameter(
        default=False,
        description="a kelvin keeps its value up to the end of the trip, as if the trip went on; otherwise "
        "it has none there",
    )
    arrival_cost_eur: str = parameter(
        "",
        "cost of the temperature of the pack on arrival, <degC>:<EUR> joined by commas, linear between, in "
        "place of what the ageing law makes of the hours after the trip; empty for none",
    )
    max_iterations: int = parameter(
        _SOLVER.max_iterations, "iterations of one solve at most", "", 1, 100_000
    )
    tolerance: float = parameter(
        _SOLVER.tolerance, "optimality tolerance of the scaled problem", "", 1e-16, 1.0
    )
    smoothing_factor: float = parameter(
        _SOLVER.smoothing_factor,
        "factor on the widths of the smoothed kinks of the model",
        "",
        0.01,
        10.0,
    )
    deadline_ms: float = parameter(
        0.0,
        "wall time of one solve at most, 0 for none; runs with a deadline are not exactly repeatable",
        "ms",
        0.0,
        60000.0,
    )
    max_preview_age_s: float = parameter(
        ControllerOptions.max_preview_age_s,
        "older previews are not used; the leader's measured motion is then extrapolated",
        "s",
        0.0,
        1e4,
    )
    shifted_plan_ticks: int = parameter(
        ControllerOptions.shifted_plan_ticks,
        "ticks that the last plan may be driven on after a failed solve",
        "",
        0,
        1000,
    )
    safe_law_ticks: int = parameter(
        ControllerOptions.safe_law_ticks,
        "ticks of the safe car-following law before the controlled stop",
        "",
        0,
        100000,
    )
    input_timeout_s: float = parameter(
        2.0,
        "time after which a tick with missing inputs is answered all the same; wall time, or trip time where "
        "that runs faster and the plant does not wait",
        "s",
        0.05,
        60.0,
    )

    def options(self, tick_s: float, trip_duration_s: float) -> ControllerOptions:
        """Return what the controller is to do.

        Args:
            tick_s: sampling time of the loop.
            trip_duration_s: trip time at which the trip ends, infinite where that is not known.

        Raises:
            IptmError: a choice does not fit another one.
        """
        strategy = self.weighted_strategy()
        # The law of a cell values the hours after the trip by itself, and cools in time for them.
        ends = not self.value_beyond_trip or strategy.in_currency or self.law() is not None
        arrival = ArrivalCost.parse(self.arrival_cost_eur)
        return ControllerOptions(
            strategy=strategy,
            horizon=Horizon.parse(self.horizon),
            solver=SolverOptions(
                max_iterations=self.max_iterations,
                deadline_s=1e-3 * self.deadline_ms,
                tolerance=self.tolerance,
                smoothing_factor=self.smoothing_factor,
            ),
            shifted_plan_ticks=self.shifted_plan_ticks,
            safe_law_ticks=self.safe_law_ticks,
            max_preview_age_s=self.max_preview_age_s,
            tick_s=tick_s,
            trip_duration_s=trip_duration_s if ends or arrival else math.inf,
            noise=NoiseSettings.of(self),
            accuracy=SensorAccuracySettings.of(self),
            road=RoadFrictionSettings.of(self),
            radio=RadioSettings.of(self),
            aging=AgingSettings.of(self),
            production=ProductionSettings.of(self),
            arrival=arrival,
        )

    def weighted_strategy(self) -> Strategy:
        """Return the strategy with the stated weights."""
        values = {key: getattr(self, key) for key in (*COST_TERMS, "reference_temperature_k")}
        stated = {key: value for key, value in values.items() if value != FROM_STRATEGY}
        return replace(strategy_by_name(self.strategy), **stated)

"""What a user chooses about the controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from iptm_controller.arrival import ArrivalCost
from iptm_controller.estimator import NoiseSettings
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.production import ProductionSettings
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES, Strategy
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.aging_laws.parking import PRICED_LAW, AgingSettings
from iptm_core.braking import RadioSettings, RoadFrictionSettings, SensorAccuracySettings


@dataclass(frozen=True)
class ControllerOptions:
    """What a user chooses about the controller.

    Attributes:
        shifted_plan_ticks: ticks for which the last plan may be driven on after a failed solve.
        safe_law_ticks: ticks of the safe car-following law after that.
        trip_duration_s: trip time at which the trip ends, infinite where that is not known.
        aging: ageing law of the cost, and how the car is used between trips.
        accuracy: stated accuracy of the measured lead vehicle.
        road: friction of the road as far as it is known.
        radio: what messages of the lead vehicle may do on their own.
        own_law: ageing law instead of the one named there.
        arrival: cost of the temperature on arrival, in place of what the law makes of it.
    """

    strategy: Strategy = STRATEGIES[DEFAULT_STRATEGY]
    horizon: Horizon = MULTI_HORIZON
    solver: SolverOptions = field(default_factory=SolverOptions)
    shifted_plan_ticks: int = 3
    safe_law_ticks: int = 120
    max_preview_age_s: float = 10.0
    tick_s: float = 1.0
    trip_duration_s: float = math.inf
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    production: ProductionSettings = field(default_factory=ProductionSettings)
    aging: AgingSettings = field(default_factory=AgingSettings)
    accuracy: SensorAccuracySettings = field(default_factory=SensorAccuracySettings)
    road: RoadFrictionSettings = field(default_factory=RoadFrictionSettings)
    radio: RadioSettings = field(default_factory=RadioSettings)
    own_law: AgingLaw | None = None
    arrival: ArrivalCost | None = None

    @property
    def law(self) -> AgingLaw | None:
        """Ageing law of the cost, None for the paper's."""
        law = self.own_law or self.aging.law()
        return law or (PRICED_LAW if self.strategy.in_currency else None)

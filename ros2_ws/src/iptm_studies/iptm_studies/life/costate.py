"""What a kelvin more on arrival costs in the end, from years that are composed with it and without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from iptm_core.aging_laws.law import AgingLaw
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_studies.life.losses import SERVICE_YEARS, losses_by_cause
from iptm_studies.life.trips import NO_COOLING, TripMap
from iptm_studies.life.usage import MONTH_DAYS, Climate, Usage
from iptm_studies.life.year import Activity, Year, year_of

STEP_K = 0.2


@dataclass(frozen=True)
class ArrivalCostates:
    """Capacity that a kelvin on arrival costs until the end of service.

    Attributes:
        cost_1_k: mean over the arrivals of a month, share of nominal capacity, shape (12,).
        arrival_k: temperatures of the pack on arrival, shape (12, drives of a day).
    """

    cost_1_k: FloatArray
    arrival_k: FloatArray


def arrival_costates(
    law: AgingLaw, usage: Usage, climate: Climate, trip: TripMap, parameters: ModelParameters
) -> ArrivalCostates:
    """Return differences of the loss over the temperature at the end of the trips of a month, uncooled.

    Args:
        law: ageing law.
        usage: pattern of use.
        climate: air.
        trip: a trip of the cycle of the usage, the same in all months.
        parameters: pack of the car.
    """

    def lost(warm_month: int, step_k: float) -> float:
        warmer = replace(trip, end_k=trip.end_k + step_k)
        year = _year(lambda month: warmer if month == warm_month else trip)
        return sum(losses_by_cause(law, year, SERVICE_YEARS).values())

    def _year(of: Callable[[int], TripMap]) -> Year:
        return year_of(usage, climate, NO_COOLING, usage.charging, of, parameters)

    trips = sum(repeats for _, repeats in usage.departures) * usage.days_a_week / 7.0
    arrivals = SERVICE_YEARS * trips * np.array(MONTH_DAYS)
    differences = [lost(month, STEP_K) - lost(month, -STEP_K) for month in range(len(MONTH_DAYS))]
    year = _year(lambda _: trip)
    driving = year.activity == Activity.DRIVING
    ends = np.flatnonzero(driving[:-1] & ~driving[1:]) + 1
    return ArrivalCostates(
        np.array(differences) / (2.0 * STEP_K * arrivals),
        np.asarray(year.load.temperature_k)[ends].reshape(len(MONTH_DAYS), -1),
    )

"""Climates: the air over the year, and what it sets of a trip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters import SourceTag, load_parameters
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import check_known

DAY_S = 86400.0
HOUR_S = 3600.0
MONTH_DAYS = (31.0, 28.25, 31.0, 30.0, 31.0, 30.0, 31.0, 31.0, 30.0, 31.0, 30.0, 31.0)
_WARMEST_H = 15.0
_DENSITY_KEY = "body.air_density_kg_m3"
_AIR_OF_DENSITY_K = 293.15
"""Temperature of the air in published road loads."""


@dataclass(frozen=True)
class Climate:
    """Air over the year, without sun.

    Attributes:
        name: place.
        source: of the temperatures.
        monthly_c: monthly means, January first, in degC.
        daily_range_k: from the coldest to the warmest hour of a day.
    """

    name: str
    source: str
    monthly_c: tuple[float, ...]
    daily_range_k: float

    def air_c(self, month: int, time_s: float) -> float:
        """Return the temperature of the air, warmest at 15 h.

        Args:
            month: 0 for January.
            time_s: time of the day.
        """
        angle = 2.0 * np.pi * (time_s - _WARMEST_H * HOUR_S) / DAY_S
        return float(self.monthly_c[month] + 0.5 * self.daily_range_k * np.cos(angle))


_COLDEST_C, _HOTTEST_C = -40.0, 60.0
CLIMATES = (
    Climate(
        "Phoenix",
        "NOAA normals 1991-2020, mean of the daily maximum and minimum of a month",
        (13.9, 15.6, 19.2, 23.1, 28.1, 33.1, 35.6, 34.7, 31.7, 25.3, 18.6, 13.1),
        12.0,
    ),
    Climate(
        "Rome",
        "the same mean, of the averages on climatestotravel.com/climate/italy/rome",
        (7.5, 8.0, 10.0, 13.0, 17.5, 22.0, 25.0, 25.0, 21.5, 17.0, 12.0, 8.5),
        10.0,
    ),
    Climate(
        "Oslo",
        "the same mean, of the averages on climatestotravel.com/climate/norway/oslo",
        (-4.5, -4.0, 0.5, 5.0, 11.5, 15.5, 17.0, 15.5, 11.5, 6.5, 0.5, -3.5),
        7.0,
    ),
)


def climate_of(given: str | float | Climate) -> Climate:
    """Return a climate by name, or the constant one of a temperature in degC.

    Raises:
        ScenarioError: the name is unknown, or no air on earth has the temperature.
    """
    if isinstance(given, Climate):
        return given
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        if not _COLDEST_C <= given <= _HOTTEST_C:
            raise ScenarioError(
                f"climate is {given:g} degC; allowed: {_COLDEST_C:g} to {_HOTTEST_C:g} degC; in K it would be"
                f" {given - CELSIUS_ZERO_K:g} degC"
            )
        return Climate(f"{given:g} degC", "given", (float(given),) * len(MONTH_DAYS), 0.0)
    known = {each.name.lower(): each for each in CLIMATES}
    name = str(given).lower()
    check_known(name, known, "climate", "climate", ScenarioError)
    return known[name]


def air_overrides(climate: str | float | Climate, parameter_set: str) -> dict[str, float]:
    """Return the parameters that a climate sets: the air, the cells of a car that stood in it, and drag.

    The density of the air belongs to a road load at 20 degC; where it was published without a temperature, as
    by the paper, it stays. Tyres, driveline and cabin do not depend on the air in this model.

    Args:
        climate: by name or a `Climate`, of which the warmest month counts, or a temperature in degC.

    Raises:
        IptmError: the climate is unknown.
    """
    air_k = round(max(climate_of(climate).monthly_c) + CELSIUS_ZERO_K, 6)
    density = load_parameters(parameter_set).sources[_DENSITY_KEY]
    changed = {
        "environment.ambient_temperature_k": air_k,
        "environment.initial_cell_temperature_k": air_k,
    }
    if density.tag is SourceTag.PUBLISHED:
        changed[_DENSITY_KEY] = density.value * _AIR_OF_DENSITY_K / air_k
    return changed

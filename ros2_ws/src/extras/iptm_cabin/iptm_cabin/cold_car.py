"""What else is dear in the cold: tyres and driveline, air, and cells whose set has no measured law.

The trip's climate sets the density of the air where a road load states its own.
"""

from __future__ import annotations

from iptm.climate import air_overrides
from iptm_core.parameters import load_parameters

ROAD_LOAD_C = 20.0
ROAD_LOAD_1_K = 8.6e-3
"""Correction of the constant part of a road load, tyres and driveline together, per kelvin (GTR 15, K_0)."""
CELL_1_K = 0.04
"""Fall of the resistance of a cell over the temperature, as fitted to the i3's (studies/validation)."""


def rolling_factor(air_c: float) -> float:
    """Return the rolling resistance at a temperature of the air, as a multiple of the one at 20 degC."""
    return 1.0 / (1.0 + ROAD_LOAD_1_K * (air_c - ROAD_LOAD_C))


def cold_overrides(parameter_set: str, air_c: float) -> dict[str, float]:
    """Return the parameters of a car that stood in air of a temperature, for ``overrides`` of a trip.

    Args:
        parameter_set: name of a car or path of its set.
    """
    loaded = load_parameters(parameter_set)
    body, cell = loaded.values.body, loaded.values.cell
    changed = air_overrides(air_c, parameter_set)
    changed["body.rolling_resistance"] = body.rolling_resistance * rolling_factor(air_c)
    if cell.resistance_exponent_1_k == 0.0:
        changed["cell.resistance_exponent_1_k"] = CELL_1_K
    return changed

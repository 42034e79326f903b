"""A number of the model as it is declared, and the units in which it may be written."""

from __future__ import annotations

from dataclasses import MISSING, field
from typing import Any

from iptm_core.declaration import ParameterSpec
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S

#: (unit written, unit of the model) -> (factor, offset added after dividing); value / factor + offset
_CONVERSIONS: dict[tuple[str, str], tuple[float, float]] = {
    ("degC", "K"): (1.0, CELSIUS_ZERO_K),
    ("km/h", "m/s"): (KM_H_PER_M_S, 0.0),
}


def accepted_units(unit: str) -> tuple[str, ...]:
    """Units in which a quantity with the model unit ``unit`` may be written, the model unit first."""
    return (unit, *(written for written, model in _CONVERSIONS if model == unit))


def to_model_unit(value: float, written_unit: str, unit: str) -> float:
    """Convert to the unit of the model; a value in that unit is unchanged to the last bit."""
    if written_unit == unit:
        return value
    divisor, offset = _CONVERSIONS[written_unit, unit]
    return value / divisor + offset


def quantity(
    symbol: str, unit: str, minimum: float, maximum: float, neutral: float | None = None
) -> Any:
    """Declare a number with the paper's symbol, its unit and its closed range; see `ParameterSpec`.

    Args:
        neutral: value at which a law that refines the paper's changes nothing. It counts where a set does
            not state the parameter; without one the parameter is required.
    """
    default = float if neutral is None else neutral
    spec = ParameterSpec("", default, "", unit, minimum, maximum, symbol=symbol)
    return field(default=MISSING if neutral is None else neutral, metadata={"spec": spec})


def count(symbol: str, minimum: int, maximum: int) -> Any:
    """Declare a whole number; see `quantity`."""
    spec = ParameterSpec("", int, "", "1", minimum, maximum, symbol=symbol)
    return field(metadata={"spec": spec})

"""The few unit conversions that parameter files, tables and pictures ask for, and nothing more."""

from __future__ import annotations

CELSIUS_ZERO_K = 273.15
KM_H_PER_M_S = 3.6

#: (unit written, unit of the model) -> (factor, offset added after dividing); value / factor + offset
_CONVERSIONS: dict[tuple[str, str], tuple[float, float]] = {
    ("degC", "K"): (1.0, CELSIUS_ZERO_K),
    ("km/h", "m/s"): (KM_H_PER_M_S, 0.0),
}


def accepted_units(unit: str) -> tuple[str, ...]:
    """Units in which a quantity with the model unit ``unit`` may be written, the model unit first."""
    return (unit, *(written for written, model in _CONVERSIONS if model == unit))


def to_model_unit(value: float, written_unit: str, unit: str) -> float:
    """Convert a value from the unit it was written in to the unit of the model.

    Args:
        value: number as written.
        written_unit: one of ``accepted_units(unit)``.
        unit: unit of the model.

    Returns:
        The value in ``unit``; unchanged to the last bit if both units agree.

    Raises:
        KeyError: for a pair of units without a conversion.
    """
    if written_unit == unit:
        return value
    divisor, offset = _CONVERSIONS[written_unit, unit]
    return value / divisor + offset

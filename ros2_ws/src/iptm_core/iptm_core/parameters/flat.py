"""Parameters as dotted key -> number, and back, with every number checked against its range.

The flat form is what travels: overrides, tables in the documentation, the copy in a bag. Python writes
a float with as many digits as it takes to read the same float back, so a flat mapping that went
through YAML or JSON gives the parameters back bit by bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import pairwise
from numbers import Real
from typing import Any, get_type_hints

from iptm_core.declaration import (
    ParameterSpec,
    TextEnum,
    accepted_units,
    parameter_specs,
    to_model_unit,
)
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.user_input import StrictMapping, shown

_BELOW = (
    *(
        (f"limits.min_{quantity}", f"limits.max_{quantity}")
        for quantity in ("acceleration_m_s2", "compressor_power_w", "speed_m_s", "temperature_k")
    ),
    ("gap.standstill_gap_m", "gap.max_gap_m"),
    ("regeneration.blend_start_m_s", "regeneration.blend_end_m_s"),
    ("charge.min_charge", "charge.initial_charge"),
    ("pack_limits.min_cell_voltage_v", "pack_limits.max_cell_voltage_v"),
)
"""Pairs of parameters of which the first one is below the second one."""
_CELL_TEMPERATURES = (
    "limits.min_temperature_k",
    "limits.max_temperature_k",
    "environment.initial_cell_temperature_k",
)


def check_consistency(values: ModelParameters, origin: str = "parameters") -> None:
    """Refuse parameters that are each inside their range and contradict each other."""
    contradictions = (*_disorder(values), *_wrong_channel(values), *_wrong_cell(values))
    for contradiction in contradictions:
        raise ParameterError(f"{origin}: {contradiction}")


def _disorder(values: ModelParameters) -> Iterator[str]:
    flat = to_flat_dict(values)
    shares = [f"charge.voltage_share_{percent}" for percent in range(0, 101, 10)]
    for low, high in pairwise(shares):
        if flat[high] < flat[low]:
            yield (
                f"{high} is {flat[high]!r}; allowed: "
                f"at least {low} = {flat[low]!r}, the voltage rises with the charge"
            )
    for low, high in _BELOW:
        if flat[low] >= flat[high]:
            yield f"{low} is {flat[low]!r}; allowed: below {high} = {flat[high]!r}"
    brakes, comfort = values.brakes.max_deceleration_m_s2, -values.limits.min_acceleration_m_s2
    if brakes < comfort:
        yield (
            f"brakes.max_deceleration_m_s2 is {brakes!r}; allowed: "
            f"from the comfort limit, -limits.min_acceleration_m_s2 = {comfort!r} m/s^2"
        )
    gap = values.gap
    if not gap.standstill_gap_m <= gap.initial_gap_m <= gap.max_gap_m:
        yield (
            f"gap.initial_gap_m is {gap.initial_gap_m!r}; allowed: "
            f"from gap.standstill_gap_m to gap.max_gap_m, {gap.standstill_gap_m!r} to {gap.max_gap_m!r} m"
        )


def _wrong_channel(values: ModelParameters) -> Iterator[str]:
    cooling, chiller = values.cooling, values.chiller
    # Heat-capacity rate of one channel (W/K); never scaled with a sampling time.
    flow_w_k = (
        cooling.coolant_specific_heat_j_kg_k * cooling.coolant_mass_flow_kg_s / values.pack.modules
    )
    ratio = cooling.convective_coefficient_w_k / flow_w_k
    if ratio >= 1.0:
        yield (
            "cooling.convective_coefficient_w_k = "
            f"{cooling.convective_coefficient_w_k!r} is not below the heat-capacity rate of one "
            f"coolant channel, {flow_w_k:.6g} W/K (cooling.coolant_specific_heat_j_kg_k "
            f"cooling.coolant_mass_flow_kg_s / pack.modules): h/C_f = {ratio:.6g}; allowed: "
            "below 1, or the coolant would overshoot the cell it passes"
        )
    slope_w_k = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * cooling.coolant_mass_flow_kg_s
    if slope_w_k < 0.0:
        yield (
            f"chiller.xi_3_w_k + chiller.xi_5_j_kg_k cooling.coolant_mass_flow_kg_s = {slope_w_k:.6g} "
            "W/K; allowed: 0 or more, or the chiller would cool less the warmer the coolant is (the "
            "coefficients belong to the coolant flow that they were fitted at)"
        )


def _wrong_cell(values: ModelParameters) -> Iterator[str]:
    cell, flat = values.cell, to_flat_dict(values)
    kappa = cell.resistance_temperature_coefficient_1_k
    lowest_v = values.pack.open_circuit_voltage_v * min(values.charge.voltage_shares)
    for key in _CELL_TEMPERATURES:
        factor = 1.0 + kappa * (flat[key] - cell.nominal_temperature_k)
        if factor <= 0.0 and cell.resistance_exponent_1_k == 0.0:
            yield (
                f"cell.resistance_temperature_coefficient_1_k = {kappa!r} makes the cell resistance "
                f"vanish at {key} = {flat[key]!r}: factor {factor:.6g}; allowed: above 0"
            )
        entropic_v = values.pack.cells_in_series * flat[key] * cell.entropic_coefficient_v_k
        if entropic_v >= lowest_v:
            yield (
                f"cell.entropic_coefficient_v_k = {cell.entropic_coefficient_v_k!r} gives an entropic "
                f"voltage of {entropic_v:.6g} V at {key} = {flat[key]!r}; allowed: "
                f"below pack.open_circuit_voltage_v = {lowest_v!r}"
            )


class SourceTag(TextEnum):
    """Source and reliability of a value."""

    PAPER = "paper"
    DERIVED = "derived"
    PUBLISHED = "published"
    FITTED = "fitted"
    CHOSEN = "chosen"
    OVERRIDE = "override"


def read_tag(written: StrictMapping) -> SourceTag:
    """Return the source that an entry of a parameter file states; overrides are tagged by the loader."""
    tags = [tag.value for tag in SourceTag if tag is not SourceTag.OVERRIDE]
    return SourceTag(written.choice("source", tags))


@dataclass(frozen=True)
class Source:
    """One value as it was written: in a unit that may differ from the model's (degC, km/h)."""

    value: float
    unit: str
    tag: SourceTag
    note: str = ""


@lru_cache(maxsize=1)
def field_specs() -> Mapping[str, ParameterSpec]:
    """Every parameter of the model by dotted key, in the order of declaration."""
    return {
        f"{group}.{spec.name}": replace(spec, name=f"{group}.{spec.name}")
        for group, group_type in _group_types().items()
        for spec in parameter_specs(group_type)
    }


def neutral_values() -> dict[str, float]:
    """Values of the parameters that need not be stated, by dotted key."""
    return {key: spec.default for key, spec in field_specs().items() if not spec.required}


@lru_cache(maxsize=1)
def _group_types() -> Mapping[str, Any]:
    hints = get_type_hints(ModelParameters)
    return {group.name: hints[group.name] for group in fields(ModelParameters)}


def allowed_numbers(spec: ParameterSpec) -> str:
    """Return the permitted range of a model parameter in words, in the unit of the model."""
    unit = "" if spec.unit == "1" else f" {spec.unit}"
    whole = "whole numbers from " if spec.kind is int else ""
    return f"{whole}{spec.minimum:g} to {spec.maximum:g}{unit}"


def checked_number(
    value: object, spec: ParameterSpec, origin: str, unit: str | None = None
) -> float:
    """Check one number and convert it to the unit of the model; refusals are a `ParameterError`.

    Args:
        unit: unit it was written in; None means the unit of the model.
    """
    where, allowed = f"{origin}: {spec.name} is {shown(value)}", allowed_numbers(spec)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ParameterError(f"{where}, no number; allowed: {allowed}")
    written_unit = spec.unit if unit is None else unit
    if written_unit not in accepted_units(spec.unit):
        units = " or ".join(repr(known) for known in accepted_units(spec.unit))
        raise ParameterError(f"{where} with unit {shown(written_unit)}; allowed: {units}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    number = to_model_unit(number, written_unit, spec.unit)
    if written_unit != spec.unit:
        where = f"{where} {written_unit} = {number!r} {spec.unit}"
    is_whole = spec.kind is int
    # NaN fails the comparison as well.
    if not spec.minimum <= number <= spec.maximum or (is_whole and not number.is_integer()):
        raise ParameterError(f"{where}; allowed: {allowed}")
    return int(number) if is_whole else number


def to_flat_dict(values: ModelParameters) -> dict[str, float]:
    """Write parameters as dotted key -> number (int for whole ones), in the order of declaration."""
    flat: dict[str, float] = {}
    for key in field_specs():
        group, name = key.split(".")
        flat[key] = getattr(getattr(values, group), name)
    return flat


def flat_to_parameters(
    mapping: Mapping[str, float], origin: str = "flat parameters"
) -> ModelParameters:
    """Build checked parameters from dotted key -> number in the units of the model.

    Those with a neutral value may be missing; unknown ones are refused.
    """
    specs = field_specs()
    mapping = StrictMapping(mapping, origin, specs, kind="parameter", error=ParameterError).content
    mapping = {**neutral_values(), **mapping}
    missing = [key for key in specs if key not in mapping]
    if missing:
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        raise ParameterError(f"{origin}: missing {', '.join(missing[:5])}{more}")
    groups: dict[str, dict[str, float]] = {}
    for key, spec in specs.items():
        group, name = key.split(".")
        groups.setdefault(group, {})[name] = checked_number(mapping[key], spec, origin)
    values = ModelParameters(
        **{group: _group_types()[group](**entries) for group, entries in groups.items()}
    )
    check_consistency(values, origin)
    return values

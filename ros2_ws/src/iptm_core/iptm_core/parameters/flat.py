"""Parameters as dotted key -> number, and back, with every number checked against its range.

The flat form is what travels: overrides, tables in the documentation, the copy in a bag. Python writes
a float with as many digits as it takes to read the same float back, so a flat mapping that went
through YAML or JSON gives the parameters back bit by bit.

The coefficients of a chiller may be a table over the ambient temperature, interpolated linearly.
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
    without_round_off,
)
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.user_input import StrictMapping, check_known, shown

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
    number = without_round_off(spec, to_model_unit(number, written_unit, spec.unit))
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


FORMER = {"gap.leader_return_s": 0.0}
"""Parameters in bags of former versions, with the values at which they changed nothing."""


def flat_to_parameters(
    mapping: Mapping[str, float], origin: str = "flat parameters"
) -> ModelParameters:
    """Build checked parameters from dotted key -> number in the units of the model.

    Those with a neutral value may be missing; unknown ones are refused.
    """
    specs = field_specs()
    known = [*specs]
    if isinstance(mapping, Mapping):
        known += [key for key, value in FORMER.items() if mapping.get(key) == value]
    mapping = StrictMapping(mapping, origin, known, kind="parameter", error=ParameterError).content
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


AMBIENT_KEY = "environment.ambient_temperature_k"
COEFFICIENT_KEYS = tuple(key for key in field_specs() if key.startswith("chiller.xi_"))
_EDGE_K = 1e-9  # round-off of a conversion may not push an edge of the table outside of it


@dataclass(frozen=True)
class ChillerTable:
    """Chiller coefficients at increasing ambient temperatures.

    Attributes:
        ambient_k: ambient temperatures, shape (n,), increasing, n >= 2.
        coefficients: dotted key -> values at those temperatures, shape (n,), in the model's units.
    """

    origin: str
    ambient_k: tuple[float, ...]
    coefficients: Mapping[str, tuple[float, ...]]
    tag: SourceTag
    note: str

    def at(self, ambient_k: float) -> dict[str, Source]:
        """Interpolate the coefficients; a row is met to the last digit, beyond the table is refused."""
        nodes_k = self.ambient_k
        if not nodes_k[0] - _EDGE_K <= ambient_k <= nodes_k[-1] + _EDGE_K:
            raise ParameterError(
                f"{self.origin}: {AMBIENT_KEY} is {ambient_k!r}, outside of the chiller table; "
                f"allowed: {nodes_k[0]:g} to {nodes_k[-1]:g} K"
            )
        for row, node_k in enumerate(nodes_k):
            if math.isclose(node_k, ambient_k, rel_tol=0.0, abs_tol=_EDGE_K):
                values = {key: column[row] for key, column in self.coefficients.items()}
                return self._sources(values, self.note)
        upper = next(row for row, node_k in enumerate(nodes_k) if node_k > ambient_k)
        low_k, high_k = nodes_k[upper - 1 : upper + 1]
        share = (ambient_k - low_k) / (high_k - low_k)
        values = {
            key: column[upper - 1] + share * (column[upper] - column[upper - 1])
            for key, column in self.coefficients.items()
        }
        remark = f"interpolated between {low_k:g} and {high_k:g} K ambient"
        return self._sources(values, "; ".join(filter(None, (self.note, remark))))

    def _sources(self, values: Mapping[str, float], note: str) -> dict[str, Source]:
        return {
            key: Source(value, field_specs()[key].unit, self.tag, note)
            for key, value in values.items()
        }


def read_chiller_table(entry: object, key: str, origin: str) -> ChillerTable:
    """Read the table of ``chiller.by_ambient_temperature``."""
    where = f"{origin}: {key}"
    known = ("source", "note", "columns", "units", "rows")
    written = StrictMapping(entry, where, known, kind="entry", error=ParameterError)
    tag, note = read_tag(written), written.text("note", "")
    by_name = {key.split(".")[1]: field_specs()[key] for key in (AMBIENT_KEY, *COEFFICIENT_KEYS)}
    names = written.entries("columns")
    for name in names:
        check_known(name, by_name, where, "column")
    if sorted(names) != sorted(by_name):
        written.refuse("columns", f"each of {', '.join(by_name)} once")
    units, rows = written.entries("units"), written.entries("rows")
    if len(units) != len(names):
        written.refuse("units", f"a list of {len(names)} units, one for each column")
    if len(rows) < 2:
        written.refuse("rows", "a list of at least two rows")
    columns: dict[str, list[float]] = {by_name[name].name: [] for name in names}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != len(names):
            raise ParameterError(
                f"{where}: rows, row {number} is {shown(row)}; allowed: a list of {len(names)} numbers"
            )
        for name, unit, value in zip(names, units, row, strict=True):
            spec = by_name[name]
            columns[spec.name].append(checked_number(value, spec, f"{where}, row {number}", unit))
    ambient_k = tuple(columns.pop(AMBIENT_KEY))
    if any(low >= high for low, high in pairwise(ambient_k)):
        raise ParameterError(
            f"{where}: ambient temperatures are {shown(ambient_k)} K; allowed: increasing ones"
        )
    coefficients = {key: tuple(columns[key]) for key in COEFFICIENT_KEYS}
    return ChillerTable(origin, ambient_k, coefficients, tag, note)

"""One parameter file read into checked entries, before it is laid over its base."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import (
    FILE_TAGS,
    Source,
    SourceTag,
    checked_number,
    field_specs,
)
from iptm_core.parameters.model import FieldSpec
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.user_input import StrictMapping, check_known, shown

AMBIENT_KEY = "environment.ambient_temperature_k"
COEFFICIENT_KEYS = tuple(key for key in field_specs() if key.startswith("chiller.xi_"))
TABLE_ENTRIES = ("source", "note", "columns", "units", "rows")
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
        """Interpolate every coefficient linearly; a row of the table is met to the last digit.

        Raises:
            ParameterError: outside of the table.
        """
        first, last = self.ambient_k[0], self.ambient_k[-1]
        if not first - _EDGE_K <= ambient_k <= last + _EDGE_K:
            raise ParameterError(
                f"{self.origin}: {AMBIENT_KEY} is {ambient_k!r}, outside of the chiller table; "
                f"allowed: {first:g} to {last:g} K"
            )
        for row, node_k in enumerate(self.ambient_k):
            if math.isclose(node_k, ambient_k, rel_tol=0.0, abs_tol=_EDGE_K):
                return {
                    key: self._source(key, column[row], "")
                    for key, column in self.coefficients.items()
                }
        upper = next(row for row, node_k in enumerate(self.ambient_k) if node_k > ambient_k)
        low_k, high_k = self.ambient_k[upper - 1], self.ambient_k[upper]
        share = (ambient_k - low_k) / (high_k - low_k)
        remark = f"interpolated between {low_k:g} and {high_k:g} K ambient"
        return {
            key: self._source(
                key, column[upper - 1] + share * (column[upper] - column[upper - 1]), remark
            )
            for key, column in self.coefficients.items()
        }

    def _source(self, key: str, value: float, remark: str) -> Source:
        note = "; ".join(part for part in (self.note, remark) if part)
        return Source(value=value, unit=field_specs()[key].unit, tag=self.tag, note=note)


def parse_chiller_table(
    written: StrictMapping, tag: SourceTag, note: str, origin: str
) -> ChillerTable:
    """Read the table of ``chiller.by_ambient_temperature``."""
    where = written.where
    specs = _column_specs(written)
    units = written.entries("units")
    if len(units) != len(specs):
        written.refuse("units", f"a list of {len(specs)} units, one for each column")
    rows = written.entries("rows")
    if len(rows) < 2:
        written.refuse("rows", "a list of at least two rows")
    columns: dict[str, list[float]] = {spec.key: [] for spec in specs}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != len(specs):
            raise ParameterError(
                f"{where}: rows, row {number} is {shown(row)}; allowed: a list of {len(specs)} numbers"
            )
        for spec, unit, value in zip(specs, units, row, strict=True):
            columns[spec.key].append(checked_number(value, spec, f"{where}, row {number}", unit))
    ambient_k = tuple(columns.pop(AMBIENT_KEY))
    if any(low >= high for low, high in pairwise(ambient_k)):
        raise ParameterError(
            f"{where}: ambient temperatures are {shown(ambient_k)} K; allowed: increasing ones"
        )
    return ChillerTable(
        origin=origin,
        ambient_k=ambient_k,
        coefficients={key: tuple(columns[key]) for key in COEFFICIENT_KEYS},
        tag=tag,
        note=note,
    )


def _column_specs(written: StrictMapping) -> list[FieldSpec]:
    by_name = {key.split(".")[1]: key for key in (AMBIENT_KEY, *COEFFICIENT_KEYS)}
    columns = written.entries("columns")
    for name in columns:
        check_known(name, by_name, written.where, "column")
    if sorted(columns) != sorted(by_name):
        written.refuse("columns", f"each of {', '.join(by_name)} once")
    return [field_specs()[by_name[name]] for name in columns]


TABLE_NAME = "by_ambient_temperature"
_HEADINGS = ("description", "base")


@dataclass(frozen=True)
class Layer:
    """What one file states.

    Attributes:
        base: name or path of the set that this one differs from, or None.
        entries: dotted key -> value as written, each already checked.
        chiller_table: coefficients over ambient temperature, or None.
    """

    origin: str
    description: str
    base: str | None
    entries: Mapping[str, Source]
    chiller_table: ChillerTable | None


def read_layer(path: Path) -> Layer:
    """Read one parameter file.

    Args:
        path: a YAML file with the groups of the model, optional ``description`` and ``base``.

    Returns:
        Its checked entries; a file with a base need not state every parameter.
    """
    origin = str(path)
    groups = dict.fromkeys(key.split(".")[0] for key in field_specs())
    document = StrictMapping(
        read_yaml(path), origin, (*groups, *_HEADINGS), kind="group", error=ParameterError
    )
    entries: dict[str, Source] = {}
    table: ChillerTable | None = None
    for name in document:
        if name in _HEADINGS:
            continue
        for field, entry in document.section(name, kind="parameter").content.items():
            key = f"{name}.{field}"
            if key == f"chiller.{TABLE_NAME}":
                table = _read_table(entry, origin)
                continue
            check_known(key, field_specs(), origin, "parameter")
            entries[key] = _read_entry(entry, field_specs()[key], origin)
    _check_single_chiller(entries, table, origin)
    return Layer(
        origin=origin,
        description=document.text("description", ""),
        base=document.text("base") if "base" in document else None,
        entries=entries,
        chiller_table=table,
    )


def _read_entry(entry: object, spec: FieldSpec, origin: str) -> Source:
    where = f"{origin}: {spec.key}"
    if not isinstance(entry, Mapping):
        raise ParameterError(
            f"{where} is {shown(entry)}; allowed: {{value: ..., unit: {spec.unit}, source: ...}}, "
            f"{spec.allowed}"
        )
    written = StrictMapping(
        entry, where, ("value", "unit", "source", "note"), kind="entry", error=ParameterError
    )
    written.require("value", "unit", allowed=f"{spec.unit}, {spec.allowed}")
    unit = written.text("unit")
    checked_number(entry["value"], spec, origin, unit)
    return Source(
        value=entry["value"], unit=unit, tag=_read_tag(written), note=written.text("note", "")
    )


def _read_table(entry: object, origin: str) -> ChillerTable:
    where = f"{origin}: chiller.{TABLE_NAME}"
    written = StrictMapping(entry, where, TABLE_ENTRIES, kind="entry", error=ParameterError)
    return parse_chiller_table(written, _read_tag(written), written.text("note", ""), origin)


def _read_tag(written: StrictMapping) -> SourceTag:
    return SourceTag(written.choice("source", [tag.value for tag in FILE_TAGS]))


def _check_single_chiller(
    entries: Mapping[str, Source], table: ChillerTable | None, origin: str
) -> None:
    stated = [key for key in COEFFICIENT_KEYS if key in entries]
    if table is not None and stated:
        raise ParameterError(
            f"{origin}: {', '.join(stated)} and chiller.{TABLE_NAME} both state the chiller; "
            "allowed: one of the two in one file"
        )

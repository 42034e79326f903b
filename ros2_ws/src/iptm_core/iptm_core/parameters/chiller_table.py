"""Chiller coefficients tabulated over ambient temperature, interpolated linearly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import FieldSpec, check_known, checked_number, field_specs, shown
from iptm_core.parameters.sources import Source, SourceTag

AMBIENT_KEY = "environment.ambient_temperature_k"
COEFFICIENT_KEYS = tuple(key for key in field_specs() if key.startswith("chiller.xi_"))
_ENTRIES = ("source", "note", "columns", "units", "rows")
_EDGE_K = 1e-9  # round-off of a conversion may not push an edge of the table outside of it


@dataclass(frozen=True)
class ChillerTable:
    """Chiller coefficients at increasing ambient temperatures.

    Attributes:
        origin: file it was read from.
        ambient_k: ambient temperatures, shape (n,), increasing, n >= 2.
        coefficients: dotted key -> values at those temperatures, shape (n,), in the model's units.
        tag: where the numbers come from.
        note: remark of the file.
    """

    origin: str
    ambient_k: tuple[float, ...]
    coefficients: Mapping[str, tuple[float, ...]]
    tag: SourceTag
    note: str

    def at(self, ambient_k: float) -> dict[str, Source]:
        """Interpolate every coefficient linearly; a row of the table is met to the last digit.

        Args:
            ambient_k: ambient temperature in kelvin.

        Returns:
            Dotted key -> coefficient with its source.

        Raises:
            ParameterError: outside of the table.
        """
        first, last = self.ambient_k[0], self.ambient_k[-1]
        if not first - _EDGE_K <= ambient_k <= last + _EDGE_K:
            raise ParameterError(
                f"{self.origin}: {AMBIENT_KEY} = {ambient_k!r}: outside of the chiller table; "
                f"permitted: {first:g} to {last:g} K"
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


def parse_chiller_table(entry: Any, tag: SourceTag, note: str, origin: str) -> ChillerTable:
    """Read the table of ``chiller.by_ambient_temperature``.

    Args:
        entry: mapping with ``source``, ``note``, ``columns``, ``units`` and ``rows``.
        tag: its source, already checked.
        note: its note, already checked.
        origin: file name for the messages.

    Returns:
        The table, temperatures in kelvin.

    Raises:
        ParameterError: for missing or unknown columns, rows of another length, values out of range, or
            ambient temperatures that do not increase.
    """
    where = f"{origin}: chiller.by_ambient_temperature"
    for key in entry:
        check_known(key, _ENTRIES, where, "entry")
    specs = _column_specs(entry.get("columns"), where)
    units = entry.get("units")
    if not isinstance(units, list) or len(units) != len(specs):
        raise ParameterError(f"{where}.units = {shown(units)}: one unit for each column is needed")
    rows = entry.get("rows")
    if not isinstance(rows, list) or len(rows) < 2:
        raise ParameterError(f"{where}.rows: a list of at least two rows is needed")
    columns: dict[str, list[float]] = {spec.key: [] for spec in specs}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != len(specs):
            raise ParameterError(
                f"{where}.rows, row {number} = {shown(row)}: a list of {len(specs)} numbers is needed"
            )
        for spec, unit, value in zip(specs, units, row, strict=True):
            columns[spec.key].append(checked_number(value, spec, f"{where}, row {number}", unit))
    ambient_k = tuple(columns.pop(AMBIENT_KEY))
    if any(low >= high for low, high in pairwise(ambient_k)):
        raise ParameterError(f"{where}: the ambient temperatures must increase from row to row")
    return ChillerTable(
        origin=origin,
        ambient_k=ambient_k,
        coefficients={key: tuple(columns[key]) for key in COEFFICIENT_KEYS},
        tag=tag,
        note=note,
    )


def _column_specs(columns: Any, where: str) -> list[FieldSpec]:
    by_name = {key.split(".")[1]: key for key in (AMBIENT_KEY, *COEFFICIENT_KEYS)}
    if not isinstance(columns, list):
        raise ParameterError(f"{where}.columns: a list of the names {', '.join(by_name)} is needed")
    for name in columns:
        check_known(name, by_name, where, "column")
    if sorted(columns) != sorted(by_name):
        raise ParameterError(
            f"{where}.columns = {shown(columns)}: each of {', '.join(by_name)} is needed once"
        )
    return [field_specs()[by_name[name]] for name in columns]

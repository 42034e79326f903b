"""Chiller coefficients tabulated over ambient temperature, interpolated linearly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import FieldSpec, Source, SourceTag, checked_number, field_specs
from iptm_core.strict_mapping import StrictMapping, check_known, shown

AMBIENT_KEY = "environment.ambient_temperature_k"
COEFFICIENT_KEYS = tuple(key for key in field_specs() if key.startswith("chiller.xi_"))
TABLE_ENTRIES = ("source", "note", "columns", "units", "rows")
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
    """Read the table of ``chiller.by_ambient_temperature``.

    Args:
        written: mapping with the keys ``TABLE_ENTRIES``.
        tag: its source, already checked.
        note: its note, already checked.
        origin: file name for the messages.

    Returns:
        The table, temperatures in kelvin.

    Raises:
        ParameterError: for missing or unknown columns, rows of another length, values out of range, or
            ambient temperatures that do not increase.
    """
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

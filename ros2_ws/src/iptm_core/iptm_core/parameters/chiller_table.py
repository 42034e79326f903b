"""Chiller coefficients tabulated over ambient temperature, interpolated linearly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import Source, SourceTag, checked_number, field_specs, read_tag
from iptm_core.user_input import StrictMapping, check_known, shown

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

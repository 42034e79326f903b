"""A drive as a file states it: rows of time, and columns of one quantity each, in SI units.

Readers return this table; a trip is made of it in `iptm_core.routes.user_csv`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.road_line import east_north_m
from iptm_core.state import FloatArray


def counted(count: int, what: str) -> str:
    """Return a count with its noun."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, shape (n, 2)."""
    result: FloatArray = np.hypot(vectors[:, 0], vectors[:, 1])
    return result


@dataclass(frozen=True, eq=False)
class DriveTable:
    """What a file states, untouched: NaN where it states nothing, or that a value is invalid.

    Attributes:
        source: file, and the vehicle in it.
        columns: by quantity (as in `iptm_core.routes.user_csv.COLUMNS`, and ``east_m`` and ``north_m``
            in a plane) one array of shape (n,) in SI units.
        rows: number of every row in the file, shape (n,).
        counted: what the numbers count.
        names: column names and SI units per unit of the file, for messages, where they differ.
        received_s: times of receipt beside those that the sender stated, shape (n,); None without.
        sparse: whether a row states some of the quantities only, as a frame of a bus does.
        notes: what the reader left out.
    """

    source: str
    columns: dict[str, FloatArray]
    rows: NDArray[np.int64]
    counted: str = "line"
    names: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    received_s: FloatArray | None = None
    sparse: bool = False
    notes: tuple[str, ...] = ()

    def having(self, **columns: FloatArray | None) -> DriveTable:
        """Return the table with other columns; None removes one."""
        merged = {**self.columns, **columns}
        kept = {name: each for name, each in merged.items() if each is not None}
        return replace(self, columns=kept)

    def noted(self, *notes: str) -> DriveTable:
        """Return the table with more notes."""
        return replace(self, notes=(*self.notes, *notes))

    def in_rows(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> DriveTable:
        """Return some of the rows, or all in another order."""
        received = None if self.received_s is None else self.received_s[which]
        columns = {name: values[which] for name, values in self.columns.items()}
        return replace(self, columns=columns, rows=self.rows[which], received_s=received)

    def kept(self, keep: NDArray[np.bool_], note: str = "") -> DriveTable:
        """Return the rows that are kept; the others are counted in a note, if there is one."""
        lost = int(np.count_nonzero(~keep))
        if not lost:
            return self
        return self.in_rows(keep).noted(*([f"{self.count(lost)} {note}"] if note else []))

    def from_zero(self) -> DriveTable:
        """Return the table with times that begin at 0."""
        times = self.columns["time_s"]
        return self.having(time_s=times - times[0])

    def plane(self) -> FloatArray | None:
        """Return places in a plane, shape (n, 2), NaN for none; None without any."""
        columns = self.columns
        if "latitude_deg" in columns:
            latitudes = columns["latitude_deg"]
            longitudes = columns["longitude_deg"]
            known = np.flatnonzero(np.isfinite(latitudes) & np.isfinite(longitudes))
            if not known.size:
                return None
            origin = (latitudes[known[0]], longitudes[known[0]])
            # Across the date line the nearer way counts.
            nearer = (longitudes - origin[1] + 180.0) % 360.0 - 180.0 + origin[1]
            return np.column_stack(east_north_m(latitudes, nearer, origin))
        if "east_m" in columns:
            return np.column_stack([columns["east_m"], columns["north_m"]])
        if "position_m" in columns:
            return np.column_stack([columns["position_m"], np.zeros(self.rows.size)])
        return None

    def named(self, quantity: str) -> tuple[str, float]:
        """Return the name of a quantity in the file, and the SI units in one of its unit."""
        return self.names.get(quantity, (quantity, 1.0))

    def count(self, rows: int) -> str:
        """Return a number of rows with its noun."""
        return counted(rows, self.counted)

    def at(self, row: int) -> str:
        """Return where a row is, for messages."""
        return f"{self.source}, {self.counted} {self.rows[row]}"

    def refuse(self, row: int, quantity: str, allowed: str) -> RouteError:
        """Return the error for a value that cannot be used."""
        name, factor = self.named(quantity)
        value = self.columns[quantity][row] / factor
        return RouteError(f"{self.at(row)}, column {name}: value {value:.12g}; allowed: {allowed}")

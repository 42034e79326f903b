"""A strict reader for small numeric CSV files: every complaint names file, line and column."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray
from iptm_core.user_input import number, read_file, shown

MAX_BYTES = 20_000_000
"""A week at 1 Hz and more."""


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A checked numeric table.

    Attributes:
        columns: one array of shape (n,) per column name.
        lines: line number of every row in the file (1 is the first line), shape (n,).
        counted: what the numbers count, where it is not lines.
    """

    source: str
    columns: dict[str, FloatArray]
    lines: tuple[int, ...]
    counted: str = "line"

    def refuse_where(self, wrong: NDArray[np.bool_], column: str, allowed: str) -> None:
        """Refuse the first row that breaks a rule; ``wrong`` has one value per row, or per step to a row."""
        for row in np.flatnonzero(wrong) + len(self.lines) - wrong.size:
            raise RouteError(
                f"{self.source}, {self.counted} {self.lines[row]}, column {column}: "
                f"value {self.columns[column][row]:.12g}; allowed: {allowed}"
            )

    def only(self, names: Iterable[str], *, needed: bool = False) -> str:
        """Return the one of some columns that the table has; empty for none, if that is permitted."""
        found = [name for name in names if name in self.columns]
        if len(found) > 1 or (needed and not found):
            count = "exactly" if needed else "at most"
            raise RouteError(
                f"{self.source}: columns {found}; allowed: {count} one of {', '.join(names)}"
            )
        return found[0] if found else ""


def read_csv_table(path: Path, known: Sequence[str]) -> CsvTable:
    """Read a numeric CSV file in UTF-8 with a header line and one row or more of finite numbers.

    A byte-order mark, either line ending, blank lines and lines that start with ``#`` are fine.
    """
    raw, source = read_file(path, MAX_BYTES, RouteError), str(path)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        line = raw.count(b"\n", 0, reason.start) + 1
        raise RouteError(
            f"{source}, line {line}: byte 0x{raw[reason.start]:02x} is not UTF-8; "
            "save the file as UTF-8 text"
        ) from reason
    return parse_csv_table(text, source, known)


def parse_csv_table(text: str, source: str, known: Sequence[str]) -> CsvTable:
    """Parse the text of a numeric CSV file; see `read_csv_table`."""
    rows = _rows(text, source)
    header_line, header = next(rows, (0, []))
    if not header:
        raise RouteError(f"{source}: the file is empty; a header line with {list(known)} is needed")
    names = [name.strip() for name in header]
    _check_header(names, source, header_line, known)
    lines: list[int] = []
    values: list[list[float]] = []
    for line, cells in rows:
        if len(cells) != len(names):
            raise RouteError(
                f"{source}, line {line}: {len(cells)} values; allowed: one per column, "
                f"{len(names)} ({', '.join(names)})"
            )
        where = f"{source}, line {line}"
        values.append(
            [finite_number(where, name, cell) for name, cell in zip(names, cells, strict=True)]
        )
        lines.append(line)
    if not values:
        raise RouteError(f"{source}: no rows after the header; at least one is needed")
    data = np.array(values, dtype=np.float64)
    columns = {name: data[:, index].copy() for index, name in enumerate(names)}
    return CsvTable(source=source, columns=columns, lines=tuple(lines))


def _rows(text: str, source: str) -> Iterator[tuple[int, list[str]]]:
    for place, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            try:
                yield place, next(csv.reader([stripped], skipinitialspace=True))
            except csv.Error as reason:
                raise RouteError(
                    f"{source}, line {place}: {reason}; plain comma-separated numbers are needed"
                ) from reason


def _check_header(names: list[str], source: str, line: int, known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise RouteError(
                f"{source}, line {line}: unknown column {name!r}; allowed: {', '.join(known)}"
            )
        if names.count(name) > 1:
            raise RouteError(
                f"{source}, line {line}: column {name!r} appears {names.count(name)} times; "
                "allowed: once"
            )


def finite_number(where: str, name: str, text: str | None) -> float:
    """Read a finite number of a user's file; others are refused."""
    try:
        value = number((text or "").strip())
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RouteError(f"{where}: {name} is {shown(text)}; allowed: a finite number")
    return value

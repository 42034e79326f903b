"""Tables of numbers as text: CSV with commas, semicolons or tabs, of programs that name quantity and unit.

Titles in front of the header, a row of units behind it, decimal commas, and columns that a drive does not
need are fine. A quantity without a unit, or a name that nearly is one of ours, is refused.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.state import FloatArray
from iptm_core.user_input import read_file, shown
from iptm_drives.cells import MISSING, MOST_INVALID, Cells, cell_value, is_day_first, seconds_of
from iptm_drives.column_names import (
    KNOWN_COLUMNS,
    UNITS,
    Meaning,
    meaning_of,
    meanings_of,
    stated_unit,
    table_of,
)

REPAIRED = "# repaired:"
_MOST_TITLES = 20
_MOST_PER_SECOND = 20


def read_content(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file, decompressed if it is one of gzip."""
    raw = read_file(path, most_bytes, RouteError)
    if not raw.startswith(b"\x1f\x8b"):
        return raw
    try:
        with gzip.open(io.BytesIO(raw)) as packed:
            content = packed.read(most_bytes + 1)
    except (OSError, EOFError, zlib.error) as reason:
        raise RouteError(
            f"{path}: cannot be decompressed ({reason}); was it cut short?"
        ) from reason
    if len(content) > most_bytes:
        raise RouteError(f"{path}: more than {most_bytes} bytes; at most {most_bytes} are read")
    return content


def text_of(raw: bytes) -> str:
    """Decode a text: UTF-8, UTF-16, else Latin-1: only comments and headers can differ."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", errors="replace")
    if raw[1:8:2] == bytes(4) or raw[:8:2] == bytes(4):
        return raw.decode("utf-16-le" if raw[0] else "utf-16-be", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def parse_text_table(text: str, source: str, columns: str = "") -> DriveTable:
    """Parse the text of a table.

    Args:
        columns: which column is what, where its name does not say: ``speed=Vehicle_Speed[km/h],time=t[ms]``.
    """
    whole = text.rstrip("\0")
    notes = [] if whole == text else [f"{len(text) - len(whole)} empty bytes at its end left out"]
    if whole.startswith(REPAIRED):  # the log that the file was made of
        notes += whole.partition("\n")[0].removeprefix(REPAIRED).strip().split("; ")
    lines = [
        (place, line.strip(" \r\n\0"))
        for place, line in enumerate(whole.splitlines(), start=1)
        if line.strip(" \t\r\n\0") and not line.lstrip().startswith("#")
    ]
    separator, lines = _separator(lines)
    rows = list(_rows(lines, source, separator))
    if not rows:
        raise RouteError(
            f"{source}: the file is empty; a header line with {', '.join(KNOWN_COLUMNS)} is needed"
        )
    start = _header_row(rows, columns)
    header_line, header = rows[start]
    if all(map(_is_number, header)):
        raise RouteError(
            f"{source}, line {header_line}: {shown(','.join(header))} are numbers; allowed: a header as "
            f"{','.join(KNOWN_COLUMNS[:2])}"
        )
    names = [name.strip() for name in header]
    meanings = meanings_of(names, f"{source}, line {header_line}", columns)
    body = [
        (line, cells)
        for line, cells in rows[start + 1 :]
        if [cell.strip() for cell in cells] != names
    ]
    if body and (units := _units_row(body[0][1], meanings)):
        meanings, body = (
            {index: Meaning(meanings[index].quantity, unit) for index, unit in units.items()},
            body[1:],
        )
    elif body and all(cell.strip().lower() in MISSING for cell in body[0][1]):
        body = body[1:]
    if not body:
        raise RouteError(f"{source}: no rows after the header; at least one is needed")
    body, lost = _whole_rows(body, len(names), source)
    notes += lost
    others = [name for index, name in enumerate(names) if name and index not in meanings]
    notes += (
        [f"not read: {', '.join(others[:8])}{', ...' if len(others) > 8 else ''}"] if others else []
    )
    texts = Cells(source)
    values = {
        index: _column(
            source, names[index], meaning, [(line, cells[index]) for line, cells in body], texts
        )
        for index, meaning in meanings.items()
    }
    notes += texts.notes(len(body), "line")
    numbers = np.array([line for line, _ in body])
    return table_of(source, names, meanings, values, numbers, notes)


def _separator(lines: list[tuple[int, str]]) -> tuple[str, list[tuple[int, str]]]:
    if lines and lines[0][1].lower().startswith("sep=") and len(lines[0][1]) > 4:
        return lines[0][1][4], lines[1:]
    texts = [line for _, line in lines[: _MOST_TITLES + 2]]
    for separator in ("\t", ";", "|"):
        if sum(separator in text for text in texts) > len(texts) // 2:
            return separator, lines
    if len(texts) > 1 and not any("," in text for text in texts):
        return " ", [(place, " ".join(line.split())) for place, line in lines]
    return ",", lines


def _rows(
    lines: Iterable[tuple[int, str]], source: str, separator: str
) -> Iterator[tuple[int, list[str]]]:
    for place, line in lines:
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error as reason:
            raise RouteError(
                f"{source}, line {place}: {reason}; plain comma-separated numbers are needed"
            ) from reason
        yield place, cells if separator == "," else [_with_decimal_point(cell) for cell in cells]


def _with_decimal_point(text: str) -> str:
    """Return a number with a decimal comma as others are written; its thousands may be marked."""
    whole = text.replace(".", "") if 0 <= text.find(".") < text.find(",") else text
    plain = whole.replace(",", ".", 1)
    return plain if _is_number(plain) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _header_row(rows: Sequence[tuple[int, list[str]]], columns: str) -> int:
    """Return the first row that names a known column; titles may stand in front of it."""
    for place, (_, cells) in enumerate(rows[:_MOST_TITLES]):
        known = sum(meaning_of(cell) is not None for cell in cells)
        if known > 1 or (
            columns and any(cell.strip() and cell.strip() in columns for cell in cells)
        ):
            return place
        if any(_is_number(cell) for cell in cells):
            break
    return 0


def _units_row(cells: Sequence[str], meanings: Mapping[int, Meaning]) -> dict[int, str]:
    """Return the units in a row below the header, empty if the row holds none."""
    stated = {
        index: stated_unit(meaning.quantity, cells[index].strip("[]() ")) or meaning.unit
        for index, meaning in meanings.items()
        if index < len(cells) and not _is_number(cells[index])
    }
    return stated if len(stated) == len(meanings) and all(stated.values()) else {}


def _whole_rows(
    body: list[tuple[int, list[str]]], count: int, source: str
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """Leave out lines with fewer or more values than columns, as a logger that was killed leaves them."""
    broken = [line for line, cells in body if len(cells) < count or any(cells[count:])]
    if len(broken) > max(1.0, MOST_INVALID * len(body)) or len(broken) == len(body):
        found = len(dict(body)[broken[0]])
        raise RouteError(
            f"{source}, line {broken[0]}: {found} values; allowed: one per column, {count}"
        )
    left_out = set(broken)
    whole = [(line, cells[:count]) for line, cells in body if line not in left_out]
    if broken == [body[-1][0]]:
        return whole, ["the last line is cut: left out"]
    note = (
        f"lines without all values left out: {len(broken)}, the first is line {broken[0]}"
        if broken
        else ""
    )
    return whole, [note] if note else []


def _column(
    source: str, name: str, meaning: Meaning, cells: list[tuple[int, str]], texts: Cells
) -> FloatArray:
    """Return the numbers of a column in its unit, NaN for what was not measured."""
    if not meaning.unit:
        units = ", ".join(f"{name}[{unit}]" for unit in list(UNITS[meaning.quantity])[:4])
        raise RouteError(
            f"{source}: unknown column {name!r}: it states no unit; allowed: {', '.join(KNOWN_COLUMNS)}, or "
            f"--columns {meaning.quantity.partition('_')[0]}={units}"
        )
    is_moment = meaning.quantity == "time_s" and any(":" in cell for _, cell in cells[:3])
    if is_moment and len({cell for _, cell in cells}) * _MOST_PER_SECOND < len(cells):
        raise RouteError(
            f"{source}: {name} is {shown(cells[0][1])}, and equal in most rows; allowed: h:m:s, with "
            "fractions of a second"
        )
    moments = partial(seconds_of, day_first=is_day_first(cell for _, cell in cells))
    by, factor = (moments, 1.0 / meaning.factor) if is_moment else (cell_value, 1.0)
    return factor * np.array([texts.read(f"line {line}", name, cell, by) for line, cell in cells])

"""Tables of numbers as text: CSV with commas, semicolons or tabs, of programs that name quantity and unit.

Titles in front of the header, a row of units behind it, decimal commas, and columns that a drive does not
need are fine. A quantity without a unit, or a name that nearly is one of ours, is refused.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.state import FloatArray
from iptm_core.user_input import shown
from iptm_drives.cells import (
    MISSING,
    MOST_INVALID,
    Cells,
    cell_value,
    degrees_of,
    is_day_first,
    is_written_clock,
    seconds_of,
)
from iptm_drives.column_names import (
    KNOWN_COLUMNS,
    Meaning,
    meaning_of,
    meanings_of,
    stated_unit,
)
from iptm_drives.long_table import widened
from iptm_drives.named_table import table_of

REPAIRED = "# repaired:"
_MOST_TITLES = 20
_MOST_PER_SECOND = 20


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
    rows = widened(rows)
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
    _refuse_another_header(source, names, body)
    if body and (units := _units_row(body[0][1], meanings)):
        meanings, body = (
            {index: Meaning(meanings[index].quantity, unit) for index, unit in units.items()},
            body[1:],
        )
    elif body and all(cell.strip().lower() in MISSING for cell in body[0][1]):
        body = body[1:]
    meanings, body = _units_in_cells(source, names, meanings, body)
    if not body:
        raise RouteError(f"{source}: no rows after the header; at least one is needed")
    body, lost = _whole_rows(body, len(names), source)
    notes += lost
    others = [name for index, name in enumerate(names) if name and index not in meanings]
    notes += (
        [f"not read: {', '.join(others[:8])}{', ...' if len(others) > 8 else ''}"] if others else []
    )
    texts = Cells(source)
    dated = any("date" in name.lower() for name in names)
    values = {
        index: _column(
            source,
            names[index],
            meaning,
            [(line, cells[index]) for line, cells in body],
            texts,
            dated,
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


def _refuse_another_header(
    source: str, names: Sequence[str], body: Iterable[tuple[int, list[str]]]
) -> None:
    for line, cells in body:
        if any(cell.strip() in names for cell in cells if not _is_number(cell) and cell.strip()):
            known = [cell for cell in cells if meaning_of(cell) is not None]
            if len(known) > 1:
                raise RouteError(
                    f"{source}, line {line}: another header, {shown(','.join(cells))}; allowed: one "
                    "recording in a file"
                )


_WITH_UNIT = re.compile(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?\s*([^\d\s.,].*)")


def _units_in_cells(
    source: str,
    names: Sequence[str],
    meanings: Mapping[int, Meaning],
    body: list[tuple[int, list[str]]],
) -> tuple[dict[int, Meaning], list[tuple[int, list[str]]]]:
    """Take units that stand behind the numbers of a column, as in ``36 km/h``, out of its cells."""
    done, ends = dict(meanings), {}
    for index, meaning in meanings.items():
        cell = body[0][1][index].strip() if body and index < len(body[0][1]) else ""
        found = _WITH_UNIT.fullmatch(cell)
        if found is not None and (unit := stated_unit(meaning.quantity, found[1])):
            inside = Meaning(meaning.quantity, unit)
            if meaning.quantity != "time_s" and meaning.unit and meaning.factor != inside.factor:
                raise RouteError(
                    f"{source}: {names[index]} states {meaning.unit}, line {body[0][0]} {found[1]}; allowed: "
                    "one unit"
                )
            done[index], ends[index] = inside, found[1]
    if not ends:
        return done, body
    return done, [
        (line, [cell.strip().removesuffix(ends.get(at, "")) for at, cell in enumerate(cells)])
        for line, cells in body
    ]


def _column(
    source: str,
    name: str,
    meaning: Meaning,
    cells: list[tuple[int, str]],
    texts: Cells,
    dated: bool,  # noqa: FBT001
) -> FloatArray:
    """Return the numbers of a column in its unit, NaN for what was not measured."""
    by, factor = cell_value, 1.0
    if meaning.quantity == "time_s":
        first = [cell for _, cell in cells[:3]]
        written = dated and is_written_clock(cell for _, cell in cells)
        if written or any(":" in cell or "T" in cell for cell in first):
            if len({cell for _, cell in cells}) * _MOST_PER_SECOND < len(cells):
                raise RouteError(
                    f"{source}: {name} is {shown(cells[0][1])}, and equal in most rows; allowed: h:m:s, "
                    "with fractions of a second"
                )
            day_first = is_day_first(cell for _, cell in cells)
            by = partial(seconds_of, day_first=day_first, written=written)
            factor = 1.0 / meaning.factor
    elif meaning.quantity in {"latitude_deg", "longitude_deg"}:
        by = degrees_of
    return factor * np.array([texts.read(f"line {line}", name, cell, by) for line, cell in cells])

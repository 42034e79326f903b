"""Tables with one value per row: time, name of the quantity, value and unit, as Car Scanner writes them."""

from __future__ import annotations

from collections.abc import Sequence

from iptm_drives.column_names import meaning_of

_NAMES, _UNITS = ("pid", "signal", "parameter", "sensor"), ("units", "unit")
_TIMES = ("seconds", "time", "timestamp")
Rows = list[tuple[int, list[str]]]


def widened(rows: Rows) -> Rows:
    """Return such a table with a column per quantity, a row per time; any other as it is."""
    header = [cell.strip().lower() for cell in rows[0][1]] if rows else []
    places = [_place(header, names) for names in (_TIMES, _NAMES, ("value",), _UNITS)]
    if min(places) < 0:
        return rows
    time, name, value, unit = places
    body = [(line, cells) for line, cells in rows[1:] if len(cells) == len(header)]
    titles = {f"{cells[name]} [{cells[unit]}]": None for _, cells in body}
    wanted = [title for title in titles if meaning_of(title) is not None]
    by_time: dict[str, tuple[int, list[str]]] = {}
    for line, cells in body:
        title = f"{cells[name]} [{cells[unit]}]"
        if title in wanted:
            _, row = by_time.setdefault(cells[time], (line, [cells[time], *("" for _ in wanted)]))
            row[1 + wanted.index(title)] = cells[value]
    return [(rows[0][0], [rows[0][1][time], *wanted]), *by_time.values()]


def _place(header: Sequence[str], names: Sequence[str]) -> int:
    return next((header.index(name) for name in names if name in header), -1)

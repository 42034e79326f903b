"""The table of a drive from named columns, of a file or in memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.state import FloatArray
from iptm_core.user_input import shown
from iptm_drives.cells import MISSING, seconds_of
from iptm_drives.column_names import KNOWN_COLUMNS, UNITS, Meaning, meanings_of
from iptm_drives.missing_units import completed

_SAME_TIME_S = 1.5


def table_of(
    source: str,
    names: Sequence[str],
    meanings: Mapping[int, Meaning],
    values: Mapping[int, FloatArray],
    numbers: NDArray[np.int64],
    notes: Iterable[str] = (),
    counted: str = "line",
) -> DriveTable:
    """Return the table of named columns, each in its unit; a quantity may be stated once."""
    meanings, found_units = completed(names, meanings, values)
    notes = [*notes, *found_units]
    _refuse_bare(source, names, meanings, counted)
    columns: dict[str, FloatArray] = {}
    shown_as: dict[str, tuple[str, float]] = {}
    for quantity in UNITS:
        found = [index for index, meaning in meanings.items() if meaning.quantity == quantity]
        found = [index for index in found if np.isfinite(values[index]).any()] or found[:1]
        if quantity == "time_s" and len(found) > 1:
            first = meanings[found[0]].in_si(values[found[0]])
            apart = [meanings[other].in_si(values[other]) - first for other in found[1:]]
            if any(np.nanmax(each) - np.nanmin(each) > _SAME_TIME_S for each in apart):
                raise RouteError(
                    f"{source}: columns {[names[index] for index in found]} are times that differ; allowed: "
                    "one, or --columns time=NAME"
                )
            found = found[:1]
        if len(found) > 1 and _are_equal(
            [meanings[each].in_si(values[each]) for each in found], _ALIKE.get(quantity, 0.0)
        ):
            found = found[:1]
        if len(found) > 1 or (quantity == "time_s" and not found):
            several = {
                "speed_m_s": "speed_m_s, speed_kmh, speed_mph",
                "slope_rad": "slope_percent, slope_rad",
            }
            count = "exactly" if quantity in {"time_s", "speed_m_s"} else "at most"
            raise RouteError(
                f"{source}: columns {[names[index] for index in found]}; allowed: {count} one of "
                f"{several.get(quantity, quantity)}, or --columns {quantity.partition('_')[0]}=NAME[UNIT]"
            )
        for index in found:
            columns[quantity] = meanings[index].in_si(values[index])
            shown_as[quantity] = names[index], meanings[index].factor
    if not columns.keys() & {"speed_m_s", "latitude_deg", "position_m"}:
        raise RouteError(
            f"{source}: columns [], no speed and no place among {', '.join(map(repr, names[:8]))}; allowed: "
            "exactly one of speed_m_s, speed_kmh, speed_mph, or places; or --columns speed=NAME[UNIT]"
        )
    notes = [*notes, *_not_the_way(columns, shown_as)]
    lone = {"latitude_deg", "longitude_deg"} - columns.keys()
    if len(lone) == 1:
        raise RouteError(f"{source}: columns {sorted(lone)} are missing; allowed: both, or none")
    return DriveTable(source, columns, numbers, counted, shown_as, notes=tuple(notes))


def _refuse_bare(
    source: str, names: Sequence[str], meanings: Mapping[int, Meaning], counted: str
) -> None:
    for index, meaning in meanings.items():
        if meaning.unit:
            continue
        name, short = names[index], meaning.quantity.partition("_")[0]
        units = ", ".join(f"{name}[{unit}]" for unit in list(UNITS[meaning.quantity])[:4])
        hint = f", or --columns {short}={units}" if counted == "line" else ""
        raise RouteError(
            f"{source}: unknown column {name!r}: it states no unit; allowed: {', '.join(KNOWN_COLUMNS)}{hint}"
        )


def _are_equal(columns: Sequence[FloatArray], apart: float) -> bool:
    """Return whether columns are the same quantity in several units, as rounded."""
    return all(np.nanmax(np.abs(each - columns[0]), initial=0.0) <= apart for each in columns[1:])


_ALIKE = {"speed_m_s": 0.3, "elevation_m": 0.6, "slope_rad": 0.001}
"""Differences up to which columns are one quantity, as rounded to a whole mile per hour or foot."""
_SAME_WAY, _COARSE_M = 0.05, 5.0
_MADE_UP = ("distance", "odometer")


def _not_the_way(
    columns: dict[str, FloatArray], shown_as: dict[str, tuple[str, float]]
) -> list[str]:
    """Leave out a distance that is not the way of the speeds, or counted too coarsely for them; note it."""
    speeds, way, times = (columns.get(name) for name in ("speed_m_s", "position_m", "time_s"))
    if speeds is None or way is None or times is None or {"latitude_deg"} & columns.keys():
        return []
    name = shown_as["position_m"][0]
    known = np.isfinite(speeds) & np.isfinite(way) & np.isfinite(times)
    if not any(word in name.lower() for word in _MADE_UP) or np.count_nonzero(known) < 2:
        return []
    driven_m = float(np.trapezoid(speeds[known], times[known]))
    apart_m = abs(float(way[known][-1] - way[known][0]) - driven_m)
    steps = np.abs(np.diff(way[known]))
    coarsest_m = float(steps[steps > 0.0].min()) if steps.any() else 0.0
    usual_m = 2.0 * float(np.median(np.abs(speeds[known]) * np.median(np.diff(times[known]))))
    if apart_m <= _SAME_WAY * abs(driven_m) and coarsest_m <= max(usual_m, _COARSE_M):
        return []
    del columns["position_m"], shown_as["position_m"]
    return [f"{name!r} is not the way of the speeds: left out"]


def columns_table(given: Mapping[str, object], source: str) -> DriveTable:
    """Return the table of columns in memory, named as in a file, each of shape (n,)."""
    names = [str(name) for name in given]
    arrays: dict[int, FloatArray] = {}
    meanings = meanings_of(names, source, "")
    for index in meanings:
        values = given[names[index]]
        arrays[index] = _numbers(values)
        if arrays[index].ndim != 1 or arrays[index].size == 0:
            raise RouteError(
                f"{source}: {names[index]} is {shown(values)}; allowed: finite numbers, one per row"
            )
        if _are_moments(values):
            meanings[index] = Meaning("time_s", "s")
    sizes = {names[index]: array.size for index, array in arrays.items()}
    if len(set(sizes.values())) > 1:
        raise RouteError(f"{source}: columns have {sizes} rows; allowed: as many in each")
    others = [name for index, name in enumerate(names) if index not in meanings]
    notes = [f"not read: {', '.join(others)}"] if others else []
    rows = np.arange(next(iter(sizes.values()), 0))
    return table_of(source, names, meanings, arrays, rows, notes, "row")


def _are_moments(values: Any) -> bool:
    return getattr(getattr(values, "dtype", None), "kind", "") == "M"


def _numbers(values: Any) -> FloatArray:
    """Return numbers, NaN where one is missing; moments and durations become seconds."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.where(values.mask, np.nan, np.asarray(values, np.float64))
    # Moments with a time zone are objects for numpy.
    array = np.asarray(values, "datetime64[ns]") if _are_moments(values) else np.asarray(values)
    if array.dtype.kind in "bc":
        return np.full((1, 1), np.nan)
    if array.dtype.kind in "mM":
        unit = "timedelta64[ns]" if array.dtype.kind == "m" else "datetime64[ns]"
        seconds = array.astype(unit).astype(np.int64) * 1e-9
        return np.where(np.isnat(array), np.nan, seconds)
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        pass
    try:
        plain = [
            "" if value is None or str(value) in {"<NA>", "NaT"} else str(value)
            for value in array.tolist()
        ]
        return np.array(
            [
                math.nan if text.lower() in MISSING else seconds_of("row", "time", text)
                for text in plain
            ]
        )
    except (TypeError, RouteError):
        return np.full((1, 1), np.nan)

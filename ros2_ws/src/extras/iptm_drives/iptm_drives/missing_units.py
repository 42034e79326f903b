"""Units that a table does not state: of a speed by its places, of a time by its size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iptm_core.routes.road_line import east_north_m
from iptm_core.state import FloatArray
from iptm_drives.column_names import UNITS, Meaning

_SPEED_UNITS = ("m/s", "km/h", "mph", "kn")
_NEAR = 0.06
"""Relative error of a way by places; miles and knots are 15 % apart."""
_MOMENTS_S = 1e9, 1e10
"""Seconds since 1970 of the years 2001 to 2286."""
_IMPERIAL = frozenset({"mph", "mi/h", "ft", "feet", "ft/s"})


def time_unit(times: FloatArray) -> str:
    """Return the unit in which times without one are moments of our days; s where they are none."""
    known = times[np.isfinite(times)]
    typical = float(np.median(known)) if known.size else 0.0
    first, last = _MOMENTS_S
    units = ("ms", "us", "ns")
    return next((unit for unit in units if first <= typical * UNITS["time_s"][unit] < last), "s")


def completed(
    names: Sequence[str], meanings: Mapping[int, Meaning], values: Mapping[int, FloatArray]
) -> tuple[dict[int, Meaning], list[str]]:
    """Return the meanings with units that could be found, without columns for which none fits, and notes.

    Speeds and heights without a unit remain so in a table without places.
    """
    done, notes = dict(meanings), []
    for index, meaning in meanings.items():
        unit = time_unit(values[index]) if meaning == Meaning("time_s", "s") else "s"
        if unit != "s":
            done[index] = Meaning("time_s", unit)
            notes.append(f"{names[index]!r} is taken in {unit}, by its size")
    at = {meaning.quantity: index for index, meaning in done.items() if meaning.unit}
    if not {"time_s", "latitude_deg", "longitude_deg"} <= at.keys():
        return done, notes
    si = {name: done[index].in_si(values[index]) for name, index in at.items()}
    bare = [index for index, meaning in done.items() if not meaning.unit]
    for index in sorted(bare, key=lambda each: done[each].quantity != "speed_m_s"):
        quantity, name = done[index].quantity, repr(names[index])
        if quantity == "speed_m_s" and "speed_m_s" in at:
            del done[index]
        elif quantity == "speed_m_s":
            if unit := _speed_unit(values[index], si):
                done[index] = Meaning(quantity, unit)
                notes.append(f"{name} states no unit: {unit} fits the places")
            else:
                del done[index]
                notes.append(f"{name} states no unit, and none fits the places: left out")
        elif quantity == "elevation_m":
            if _IMPERIAL.isdisjoint(meaning.unit for meaning in done.values()):
                done[index] = Meaning(quantity, "m")
                notes.append(f"{name} states no unit: taken in m")
            else:
                del done[index]
                notes.append(f"{name} states no unit beside miles or feet: left out")
    return done, notes


def _speed_unit(speeds: FloatArray, si: Mapping[str, FloatArray]) -> str:
    """Return the unit in which speeds cover the way of the places, empty for none."""
    times, latitudes, longitudes = (
        si[name] for name in ("time_s", "latitude_deg", "longitude_deg")
    )
    known = np.isfinite(speeds + times + latitudes + longitudes)
    if np.count_nonzero(known) < 2:
        return ""
    origin = latitudes[known][0], longitudes[known][0]
    east, north = east_north_m(latitudes[known], longitudes[known], origin)
    means = 0.5 * (speeds[known][1:] + speeds[known][:-1])
    moves = means > 0.0
    driven = float(np.sum((means * np.diff(times[known]))[moves]))
    way_m = float(np.sum(np.hypot(np.diff(east), np.diff(north))[moves]))
    if not driven > 0.0:
        return ""
    factors = UNITS["speed_m_s"]
    best = min(_SPEED_UNITS, key=lambda unit: abs(way_m / (driven * factors[unit]) - 1.0))
    return best if abs(way_m / (driven * factors[best]) - 1.0) <= _NEAR else ""

"""Names of columns: quantity and unit that they stand for.

``Vehicle_Speed [km/h]``, ``cycMps`` and ``elevation (ft)`` are understood; a quantity that has several usual
units needs one. Users say what other columns are: ``speed=NAME[UNIT]``.
"""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion

KNOWN_COLUMNS = (
    "time_s",
    "speed_m_s",
    "speed_kmh",
    "speed_mph",
    "slope_percent",
    "slope_rad",
    "elevation_m",
    "latitude_deg",
    "longitude_deg",
)
"""Names of our own."""
_DISPENSABLE = frozenset({"position_m", "acceleration_m_s2"})
"""Left out where their unit is not stated."""
_NEARLY = 0.8
_SHORT = {
    "speed": "speed_m_s",
    "time": "time_s",
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
    "elevation": "elevation_m",
    "slope": "slope_rad",
    "position": "position_m",
}

FRACTION = "fraction"
UNITS: Mapping[str, Mapping[str, float]] = {
    "time_s": {
        "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6,
        "ns": 1e-9, "min": 60.0, "minutes": 60.0, "h": 3600.0, "days": 86400.0,
    },
    "speed_m_s": {
        "m/s": 1.0, "mps": 1.0, "m/sec": 1.0, "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "kph": 1.0 / 3.6,
        "kmph": 1.0 / 3.6, "km/hr": 1.0 / 3.6, "mph": 0.44704, "mi/h": 0.44704, "kn": 0.514444,
        "m s-1": 1.0, "m s^-1": 1.0, "cm/s": 1e-2, "km h-1": 1.0 / 3.6,
        "kt": 0.514444, "kts": 0.514444, "knot": 0.514444, "knots": 0.514444, "ft/s": 0.3048,
    },
    "acceleration_m_s2": {
        "m/s2": 1.0, "m/s^2": 1.0, "m/s/s": 1.0, "m/s²": 1.0, "mps2": 1.0, "g": 9.80665,
    },
    "latitude_deg": {
        "deg": 1.0, "°": 1.0, "degree": 1.0, "degrees": 1.0, "rad": 180.0 / math.pi, "e7": 1e-7,
    },
    "elevation_m": {"m": 1.0, "meter": 1.0, "meters": 1.0, "ft": 0.3048, "feet": 0.3048, "km": 1e3},
    "slope_rad": {
        "percent": 1e-2, "%": 1e-2, FRACTION: 1.0, "rad": 1.0, "deg": math.pi / 180.0,
        "degree": math.pi / 180.0, "degrees": math.pi / 180.0, "°": math.pi / 180.0,
    },
}  # fmt: skip
"""SI units in one of a unit, by quantity; a slope in percent or as a fraction is rise over run."""
UNITS = {**UNITS, "longitude_deg": UNITS["latitude_deg"], "position_m": UNITS["elevation_m"]}
_RISES = ("percent", "%", FRACTION)
_WORDS = {
    "time_s": {
        "time", "t", "timestamp", "datetime", "elapsed", "utc", "tow", "tst",
        "zeit", "temps", "tiempo", "tempo", "tijd",
    },
    "speed_m_s": {
        "speed", "velocity", "spd", "v", "sog",
        "geschwindigkeit", "vitesse", "velocidad", "velocita", "snelheid",
    },
    "acceleration_m_s2": {"acceleration", "accel", "acc"},
    "latitude_deg": {"latitude", "lat", "breitengrad"},
    "longitude_deg": {"longitude", "lon", "lng", "long", "langengrad"},
    "elevation_m": {"elevation", "altitude", "height", "ele", "alt", "hohe"},
    "slope_rad": {"slope", "grade", "gradient"},
    "position_m": {"position", "distance", "odometer"},
}  # fmt: skip
_BESIDES = frozenset(
    re.findall(
        r"\w+",
        "cyc cycle vehicle veh target test actual measured gps gnss obd device ego utc local unix epoch of"
        " road schedule drive timestep stamp relative ground",
    )
) | {"n/s", "e/w"}
"""Words that leave the meaning of a header as it is."""
_OF_OTHERS = frozenset(
    re.findall(
        r"\w+",
        "wind set desired limit cruise lead leader leading front preceding ahead ttc thw gap headway"
        " following clearance engine motor fan wheel rotor mean average max maximum min minimum",
    )
)
"""Words of quantities of something else than the car on its way."""
_ASSUMED = {"time_s": "s", "latitude_deg": "deg", "longitude_deg": "deg"}
"""Units where none is stated; all other quantities have several that are common."""


@dataclass(frozen=True)
class Meaning:
    """What a column holds: a quantity of `UNITS`, and its unit, empty if none is stated."""

    quantity: str
    unit: str

    def in_si(self, values: FloatArray) -> FloatArray:
        """Return values in SI units, shape (n,)."""
        if self.unit in _RISES:
            return np.arctan(values if self.unit == FRACTION else values / 100.0)
        return values * self.factor

    def from_si(self, values: FloatArray) -> FloatArray:
        """Return values in this unit, shape (n,)."""
        if self.unit in _RISES:
            return np.tan(values) * (1.0 if self.unit == FRACTION else 100.0)
        return values / self.factor

    @property
    def factor(self) -> float:
        """SI units in one of the unit."""
        return UNITS[self.quantity][self.unit]


def stated_unit(quantity: str, text: str) -> str:
    """Return the unit of a quantity that a text stands for, empty for none."""
    plain = text.strip().lower().replace(" per ", "/").replace("meters/second", "m/s")
    plain = (
        plain.replace("_per_", "/").replace("miles/hour", "mph").replace("kilometers/hour", "km/h")
    )
    return plain if plain in UNITS[quantity] else ""


def meaning_of(header: str) -> Meaning | None:
    """Return what the header of a column means, None if it is unknown."""
    parts = unicodedata.normalize("NFD", header.strip())
    plain = "".join(each for each in parts if not unicodedata.combining(each))
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", plain).lower()
    text = text.replace("meters_per_second", "mps").replace("m_s2", "mps2").replace("m_s", "mps")
    text = text.replace("miles_per_hour", "mph").replace("km_h", "kmh")
    bracket = re.search(r"[\[(]([^\])]*)[\])]|,\s*(\S+)\s*$", text)
    inner = (bracket.group(1) or bracket.group(2) or "") if bracket else ""
    words = [
        word
        for word in re.split(
            r"[^a-z0-9²°%/^]+", text.replace(bracket.group(0), " ") if bracket else text
        )
        if word
    ]
    if _OF_OTHERS.intersection(words):
        return None
    rest = [word for word in words if word not in _BESIDES] or [*{"utc"}.intersection(words)]
    for quantity, names in _WORDS.items():
        others = [word for word in rest if word not in names]
        named = len(others) < len(rest)
        unit = stated_unit(quantity, inner) or stated_unit(quantity, " ".join(others))
        # A speed or a time may be named by its unit alone: "mps", "secs".
        alone = (
            quantity in {"speed_m_s", "time_s"}
            and len(others) == 1
            and len(others[0]) > 2
            and stated_unit(quantity, others[0])
        )
        if (named or alone) and (unit or not (others or inner)):
            if not unit and quantity == "slope_rad" and "cyc" in words:
                unit = FRACTION
            return Meaning(quantity, unit or _ASSUMED.get(quantity, ""))
    return None


def meanings_of(names: list[str], where: str, columns: str) -> dict[int, Meaning]:
    """Return what the columns hold, by index."""
    chosen = _chosen(names, where, columns)
    taken = {meaning.quantity for meaning in chosen.values()}
    own = {name: meaning_of(name) for name in names if name in KNOWN_COLUMNS}
    own_quantities = {meaning.quantity for meaning in own.values() if meaning is not None}
    found = dict(chosen)
    is_fastsim = "mps" in names or "speed_meters_per_second" in names
    for index, name in enumerate(names):
        if name and names.count(name) > 1 and meaning_of(name) is not None:
            raise RouteError(
                f"{where}: column {name!r} appears {names.count(name)} times; allowed: once"
            )
        meaning = meaning_of(name) if name else None
        if index in chosen or (meaning is not None and meaning.quantity in taken):
            continue
        if meaning is not None and meaning.quantity in own_quantities and name not in own:
            continue  # a name of our own wins
        near = difflib.get_close_matches(name, KNOWN_COLUMNS, n=1, cutoff=_NEARLY)
        if meaning is None and near:
            raise RouteError(f"{where}: unknown column {name!r}; {suggestion(name, KNOWN_COLUMNS)}")
        if meaning is not None and (meaning.unit or meaning.quantity not in _DISPENSABLE):
            unit = (
                "fraction" if is_fastsim and not meaning.unit and name == "grade" else meaning.unit
            )
            found[index] = Meaning(meaning.quantity, unit)
    dates = [index for index, name in enumerate(names) if name.lower() == "date"]
    if dates and all(meaning.quantity != "time_s" for meaning in found.values()):
        found[dates[0]] = Meaning("time_s", "s")
    if not found:
        raise RouteError(
            f"{where}: unknown column {names[0]!r}; allowed: {', '.join(KNOWN_COLUMNS)}"
        )
    return found


def _chosen(names: list[str], where: str, columns: str) -> dict[int, Meaning]:
    """Return what the user said of the columns."""
    chosen: dict[int, Meaning] = {}
    for part in filter(None, columns.split(",")):
        short, _, wanted = part.partition("=")
        quantity = _SHORT.get(short.strip(), "")
        bare, _, unit = wanted.strip().removesuffix("]").rpartition("[")
        name = wanted.strip() if wanted.strip() in names or not bare else bare
        if not quantity or name not in names:
            unknown, known = (short, _SHORT) if not quantity else (name, names)
            raise RouteError(
                f"{where}: --columns {part!r}: no {unknown!r}; {suggestion(unknown, known)}"
            )
        stated = stated_unit(quantity, unit)
        meaning = meaning_of(name)
        if not stated and meaning is not None and meaning.quantity == quantity:
            stated = meaning.unit
        if not stated and quantity in {"time_s", "latitude_deg", "longitude_deg"}:
            stated = next(iter(UNITS[quantity]))
        if not stated:
            raise RouteError(
                f"{where}: --columns {part!r}: unit {unit!r}; allowed: {short}=NAME[UNIT], UNIT one of "
                f"{', '.join(UNITS[quantity])}"
            )
        chosen[names.index(name)] = Meaning(quantity, stated)
    return chosen

"""A vehicle's drive in SUMO's floating car data (``sumo --fcd-output``), as a table.

Where it drives is known from a file written with ``--fcd-output.geo``, whose places are degrees; else the
slope of its road alone.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.csv_table import CsvTable
from iptm_core.routes.plain_xml import PlainXml, finite_number, read_xml
from iptm_core.state import FloatArray
from iptm_core.strict_mapping import suggestion

FCD_SUFFIX = ".xml"
MAX_BYTES = 1_000_000_000
"""Of one vehicle only its own rows are kept."""
_KIND = "SUMO FCD"
_LONGEST_ID = 200
_DEGREES_PER_M = 1e-3
"""Places that move by less for each metre of way are degrees; by metres of a plane they move by 1."""


class _Vehicle(PlainXml):
    """Keeps the rows of one vehicle, and the names of all.

    Attributes:
        name: of the vehicle; the first one where none was named.
        names: all, in the order of the file.
        rows: attributes of the vehicle and the time, in the order of the file.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.names: dict[str, None] = {}
        self.rows: list[dict[str, str]] = []
        self._time = ""

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take an element; the parser calls this."""
        if tag == "timestep":
            self._time = attributes.get("time", "")
        elif tag == "vehicle":
            name = attributes.get("id", "")
            if len(name) > _LONGEST_ID:
                raise RouteError(
                    f"a vehicle's id has {len(name)} characters; allowed: up to {_LONGEST_ID}"
                )
            self.names.setdefault(name)
            self.name = self.name or name
            if name == self.name:
                self.rows.append({**attributes, "time": self._time})


def read_fcd(path: Path, name: str) -> CsvTable:
    """Read the drive of a vehicle.

    Args:
        path: the file.
        name: of the vehicle; "" for the only one.

    Returns:
        Columns ``time_s`` and ``speed_m_s``, and as far as available ``latitude_deg``,
        ``longitude_deg`` and ``elevation_m``, or ``slope_rad``.

    Raises:
        RouteError: no such file, no XML, no such vehicle, several where none is named, or one of its rows
            lacks time or speed.
    """
    vehicle = _Vehicle(name)
    read_xml(path, MAX_BYTES, _KIND, vehicle)
    if not vehicle.rows:
        known = suggestion(name, vehicle.names) if vehicle.names else "it holds none"
        raise RouteError(f"{path}: no vehicle {name!r}; {known}")
    if not name and len(vehicle.names) > 1:
        raise RouteError(
            f"{path} holds {len(vehicle.names)} vehicles; name one: {path}#{vehicle.name}"
        )
    source = f"{path}#{vehicle.name}"

    def column(key: str) -> FloatArray:
        return np.array(
            [
                finite_number(f"{source}, row {index}", key, row.get(key))
                for index, row in enumerate(vehicle.rows, start=1)
            ]
        )

    columns = {"time_s": column("time"), "speed_m_s": column("speed")}
    first = vehicle.rows[0]
    if {"x", "y"} <= first.keys():
        longitudes, latitudes = column("x"), column("y")
        distance_m = float(np.diff(columns["time_s"]) @ columns["speed_m_s"][1:])
        if np.hypot(np.diff(longitudes), np.diff(latitudes)).sum() < _DEGREES_PER_M * distance_m:
            columns |= {"latitude_deg": latitudes, "longitude_deg": longitudes}
    if "latitude_deg" in columns:
        columns |= {"elevation_m": column("z")} if "z" in first else {}
    elif "slope" in first:
        columns["slope_rad"] = np.radians(column("slope"))
    return CsvTable(source, columns, tuple(range(1, len(vehicle.rows) + 1)), "row")

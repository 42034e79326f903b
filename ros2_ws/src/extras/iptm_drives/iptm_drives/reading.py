"""Reads a drive out of a file of any kind, and makes one trip of what it states.

Columns of a CSV file may have other names with a unit (see `iptm_drives.column_names`), or are named:
``FILE.csv#speed=NAME[UNIT]``. Without a speed, that of the places is taken (see `iptm_core.routes.track`).

Other files hold the drives of several vehicles, one of which is named behind a ``#``: SUMO's floating car
data (see `iptm_drives.xml_drives`), and bags of ROS (see `iptm_drives.bag`). Whatever the file, what it
states is cleaned in one way (see `iptm_drives.cleaning`).
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.route import BAG_SUFFIXES, GPX_SUFFIX
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.track import read_out, road_through
from iptm_core.routes.user_csv import MAX_BYTES, trip_of
from iptm_core.routes.user_trip import UserTrip
from iptm_core.user_input import file_and_name
from iptm_drives.cleaning import clean
from iptm_drives.foreign_files import read_foreign
from iptm_drives.named_table import columns_table
from iptm_drives.packed import SUFFIXES, is_archive, only_drive, read_content
from iptm_drives.text_table import parse_text_table, text_of
from iptm_drives.xml_drives import (
    FCD_NAME,
    FCD_TIME,
    MAX_FCD_BYTES,
    read_fcd,
    read_fcd_rows,
    read_gpx,
)


def trip_of_table(path: Path, table: DriveTable) -> UserTrip:
    """Return the trip in a table that was read from a file."""
    return trip_of(path, clean(table))


def read_road(path: Path) -> tuple[RoadLine, SlopeProfile | None]:
    """Read the road of a recorded drive or a plan without times; no slope where no point has a height."""
    table = read_gpx(path)
    if np.isfinite(table.columns["time_s"]).any():
        drive = read_out(clean(table))
        return drive.line, drive.slope
    known = np.isfinite(table.columns["latitude_deg"]) & np.isfinite(table.columns["longitude_deg"])
    places = {name: values[known] for name, values in table.columns.items()}
    heights = places.get("elevation_m")
    if heights is not None:
        stated, points = np.isfinite(heights), np.arange(heights.size)
        heights = np.interp(points, points[stated], heights[stated])
    return road_through(str(path), places["latitude_deg"], places["longitude_deg"], heights)


def read_drive_table(path: Path) -> DriveTable:
    """Read what a file states, whatever its kind; behind a ``#`` stands the vehicle, or the columns."""
    file, name = file_and_name(path)
    kind = file.name.lower()
    for suffix in SUFFIXES:
        kind = kind.removesuffix(suffix)
    if kind.endswith(GPX_SUFFIX):
        table = read_gpx(file)
        if not np.isfinite(table.columns["time_s"]).any():
            raise RouteError(
                f"{path}: time is missing at all points, so it is a road and no drive; allowed: as slope "
                "of another cycle"
            )
        return table
    if kind.endswith(".xml"):
        return read_fcd(file, name)
    if kind.endswith(".parquet"):
        return _of_parquet(file, name)
    if kind.endswith(BAG_SUFFIXES) or file.is_dir():
        # Loaded only now: no other cycle needs it, and every node would wait for it.
        from iptm_drives.bag import read_bag  # noqa: PLC0415

        return read_bag(file, name)
    return _of_content(file, name, read_content(file, MAX_FCD_BYTES))


def _of_content(file: Path, name: str, raw: bytes) -> DriveTable:
    """Read what the content of a file states that its suffix does not name."""
    head = raw.partition(b"\n")[0]
    if FCD_TIME.encode() in head and FCD_NAME.encode() in head:
        separator = ";" if b";" in head else ","
        return read_fcd_rows(
            file, name, csv.DictReader(io.StringIO(text_of(raw)), delimiter=separator)
        )
    if len(raw) > MAX_BYTES:
        raise RouteError(f"{file}: {len(raw)} bytes; at most {MAX_BYTES} are read")
    if is_archive(raw):
        with only_drive(file, raw, MAX_BYTES) as inside:
            return read_drive_table(inside.with_name(f"{inside.name}#{name}") if name else inside)
    if (foreign := read_foreign(file, raw, name)) is not None:
        return foreign
    return parse_text_table(text_of(raw), str(file), name)


def _of_parquet(path: Path, name: str) -> DriveTable:
    import pandas as pd  # noqa: PLC0415 - and pyarrow, which no other cycle needs

    if not path.is_file():
        raise RouteError(f"{path}: no such file; allowed: the path of an existing one")
    try:
        frame = pd.read_parquet(path)
        frame = frame if frame.index.name is None else frame.reset_index()
    except Exception as reason:  # pyarrow has error types of its own
        raise RouteError(f"{path}: cannot be read as Parquet ({reason})") from reason
    if FCD_NAME in frame and FCD_TIME in frame:
        return read_fcd_rows(path, name, frame.to_dict("records"))
    return columns_table({str(key): frame[key].to_numpy() for key in frame}, str(path))

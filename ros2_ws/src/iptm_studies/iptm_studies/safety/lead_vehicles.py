"""Measured lead vehicles as driving cycles: files of speed over time, one for each vehicle."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from iptm_core.errors import IptmError, RouteError
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.state import FloatArray

ASTAZERO = "openacc_astazero_5hz.csv.gz"
"""OpenACC, JRC of the European Commission, AstaZero 2019, CC BY 4.0: run, place, time_s, speed_m_s."""
BMW_I3 = "bmw_i3_1hz.csv.gz"
"""Steinstraeter et al., TU Munich, IEEE DataPort, CC BY 4.0: trip, time_s, speed_km_h."""
LEADS = 40
LONGEST_S = 600.0
LANDING_M_S2 = 1.0
"""Deceleration at the end of a part of a drive."""
FASTEST_M_S = 36.0
"""The shipped vehicle does 40 m/s and has to follow."""

_Drive = tuple[str, FloatArray, FloatArray]


def lead_cycles(source: Path, folder: Path, count: int = LEADS) -> list[str]:
    """Write measured lead vehicles as drive files, half of each set as far as there are enough.

    Args:
        source: folder with the files of `ASTAZERO` and `BMW_I3`.
        folder: for the drive files; made if need be.
        count: number of lead vehicles.

    Returns:
        Paths of the drive files, as cycles of a run.

    Raises:
        RouteError: a file is missing or cannot be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cycles: list[str] = []
    for drives, share in ((_astazero(source), count // 2), (_bmw_i3(source), count - count // 2)):
        usable = [drive for drive in drives if drive[2].max() <= FASTEST_M_S]
        chosen = np.linspace(0, len(usable) - 1, min(4 * share, len(usable))).round().astype(int)
        written = (_write(folder, usable[index]) for index in dict.fromkeys(chosen.tolist()))
        found = [path for path in written if path]
        kept = np.linspace(0, len(found) - 1, min(share, len(found))).round().astype(int)
        cycles += [found[index] for index in dict.fromkeys(kept.tolist())]
    return cycles


def _write(folder: Path, drive: _Drive) -> str:
    """Write a drive; returns its path, empty for one that no route can be made of."""
    name, times_s, speeds_m_s = drive
    path = folder / f"{name}.csv"
    lines = [f"{time:.3f},{speed:.4f}" for time, speed in zip(times_s, speeds_m_s, strict=True)]
    text = "\n".join(("time_s,speed_m_s", *lines)) + "\n"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
    try:
        read_user_trip(path)
    except IptmError:
        return ""
    return str(path)


def _rows(path: Path) -> Iterator[dict[str, str]]:
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            yield from csv.DictReader(file)
    except OSError as error:
        raise RouteError(f"{path} cannot be read: {error}") from None


def _astazero(source: Path) -> list[_Drive]:
    rows = sorted(
        _rows(source / ASTAZERO),
        key=lambda row: (row["run"], int(row["place"]), float(row["time_s"])),
    )
    return [
        _drive(f"astazero_{run}_{place}", list(group), "speed_m_s", 1.0)
        for (run, place), group in groupby(rows, key=lambda row: (row["run"], row["place"]))
    ]


def _bmw_i3(source: Path) -> list[_Drive]:
    return [
        _drive(f"i3_{trip}", list(group), "speed_km_h", 1.0 / 3.6)
        for trip, group in groupby(_rows(source / BMW_I3), key=lambda row: row["trip"])
    ]


def _drive(name: str, rows: list[dict[str, str]], column: str, factor: float) -> _Drive:
    numbers = np.array([(float(row["time_s"]), float(row[column])) for row in rows if row[column]])
    times_s = numbers[:, 0] - numbers[0, 0]
    first = times_s <= LONGEST_S
    speeds_m_s = np.maximum(numbers[first, 1] * factor, 0.0)
    return name, *_to_standstill(times_s[first], speeds_m_s)


def _to_standstill(times_s: FloatArray, speeds_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a drive that ends at standstill: a route has its lead vehicle stand at its end."""
    if speeds_m_s[-1] == 0.0:
        return times_s, speeds_m_s
    halt_s = float(times_s[-1] + np.ceil(speeds_m_s[-1] / LANDING_M_S2))
    return np.append(times_s, [halt_s, halt_s + 5.0]), np.append(speeds_m_s, [0.0, 0.0])

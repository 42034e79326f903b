"""Measured lead vehicles as driving cycles: files of speed over time, one for each vehicle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from iptm_core.errors import IptmError
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.state import FloatArray
from iptm_studies.drives import write_drive
from iptm_validation.measurements import Drive, Driver
from iptm_validation.readers.folder import excerpts, files_of, read_files

T = TypeVar("T")
LEADS = 40
LONGEST_S = 600.0
SHORTEST_S = 60.0
FASTEST_M_S = 36.0
"""The shipped vehicle does 40 m/s and has to follow."""


def lead_cycles(
    source: Path | None, folder: Path, report: Callable[[str], None], count: int = LEADS
) -> list[str]:
    """Write measured lead vehicles as drive files, half of them from roads where there are enough.

    Args:
        source: folder with measurements; None for the excerpts of the project.
        folder: for the drive files; made if need be.
        report: takes one line per file of measurements that was left out.
        count: number of lead vehicles.

    Returns:
        Paths of the drive files, as cycles of a run.
    """
    drives = read_files(files_of(source or excerpts()), report).drives
    folder.mkdir(parents=True, exist_ok=True)
    road = [drive for drive in drives if drive.driver is Driver.ROAD]
    others = [drive for drive in drives if drive.driver is not Driver.ROAD]
    cycles: list[str] = []
    for group, share in ((road, count // 2), (others, count)):
        written = (_write(folder, drive) for drive in _evenly(group, 4 * share))
        cycles += _evenly([path for path in written if path], share - len(cycles))
    return cycles


def _evenly(items: Sequence[T], count: int) -> list[T]:
    """Return some items, evenly spread over all."""
    places = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[place] for place in dict.fromkeys(places.tolist())]


def _write(folder: Path, drive: Drive) -> str:
    """Write the longest part of a drive without gaps; returns its path, empty for no usable one."""
    speeds_m_s = np.maximum(_longest_part(drive.speed_m_s)[: round(LONGEST_S / drive.step_s)], 0.0)
    if speeds_m_s.size < SHORTEST_S / drive.step_s or speeds_m_s.max() > FASTEST_M_S:
        return ""
    path = folder / f"{drive.name.replace('/', '_')}.csv"
    write_drive(path, drive.step_s, speeds_m_s)
    try:
        read_user_trip(path)
    except IptmError:
        return ""
    return str(path)


def _longest_part(speeds_m_s: FloatArray) -> FloatArray:
    """Return the longest series of known speeds."""
    gaps = np.flatnonzero(~np.isfinite(speeds_m_s))
    edges = np.concatenate(([-1], gaps, [speeds_m_s.size]))
    longest = int(np.argmax(np.diff(edges)))
    return speeds_m_s[edges[longest] + 1 : edges[longest + 1]]

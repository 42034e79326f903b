"""Measured trips of the BMW i3 as driving cycles with their elevation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from iptm_core.errors import MeasurementError
from iptm_core.state import FloatArray
from iptm_studies.drives import write_drive
from iptm_validation.measurements import Trip
from iptm_validation.models.i3_vehicle import road_slope_rad
from iptm_validation.readers.folder import excerpts, files_of, read_files

TRIPS = 10
LONGEST_S = 300.0
FASTEST_M_S = 36.0
"""The slowest car does 40 m/s and has to follow."""
MOVING_M_S = 0.5
STANDING_BEFORE_S = 2.0


def trip_cycles(
    source: Path | None, folder: Path, report: Callable[[str], None], count: int = TRIPS
) -> list[str]:
    """Write the first five minutes of measured trips as drive files, evenly spread over all trips.

    The slope is that of the recorded elevation, smoothed over 400 m to either side.

    Args:
        source: folder with measurements; None for the excerpts of the project.
        folder: for the drive files; made if need be.
        report: takes one line per file of measurements that was left out.
        count: number of trips.

    Returns:
        Paths of the drive files, as cycles of a run.

    Raises:
        MeasurementError: the folder holds fewer trips.
    """
    paths = files_of(source) if source else sorted(excerpts().glob("bmw_i3*"))
    trips = read_files(paths, report).trips
    parts = {trip.name: _beginning(trip) for trip in trips}
    slow = [name for name, (speeds, _) in parts.items() if speeds.max() <= FASTEST_M_S]
    if len(slow) < count:
        raise MeasurementError(
            f"{source or excerpts()} has {len(slow)} trips of the i3 below {FASTEST_M_S:g} m/s;"
            f" allowed: at least {count}"
        )
    places = np.linspace(0, len(slow) - 1, count).round().astype(int)
    chosen = [slow[place] for place in places]
    return [str(write_drive(folder / f"i3_{name}.csv", 1.0, *parts[name])) for name in chosen]


def _beginning(trip: Trip) -> tuple[FloatArray, FloatArray]:
    """Return speeds and slopes at steps of a second from shortly before the departure on."""
    departure_s = float(trip.time_s[int(np.argmax(trip.speed_m_s > MOVING_M_S))])
    begin_s = max(departure_s - STANDING_BEFORE_S, 0.0)
    grid = np.arange(begin_s, min(begin_s + LONGEST_S, float(trip.time_s[-1])) + 0.5)
    speeds = np.interp(grid, trip.time_s, trip.speed_m_s)
    return speeds, np.interp(grid, trip.time_s, road_slope_rad(trip))

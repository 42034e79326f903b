"""A recorded drive as it was read, in words and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iptm_core.routes.track import RecordedDrive, steps_m
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray
from iptm_core.units import KM_H_PER_M_S


def description(trip: UserTrip) -> str:
    """Return what was read, in lines."""
    cycle, drive = trip.cycle, trip.drive
    length_km, fastest_km_h = 1e-3 * cycle.distance_m, KM_H_PER_M_S * cycle.max_speed_m_s
    lines = [
        f"{cycle.name}: {cycle.duration_s:g} s, {length_km:.2f} km, up to {fastest_km_h:.0f} km/h"
    ]
    if trip.slope is not None:
        grades = 100.0 * np.tan(trip.slope.slopes_rad)
        lines.append(f"grade {grades.min():.1f} to {grades.max():.1f} %")
    if drive is not None:
        source = "of the receiver" if "speed_m_s" in drive.raw.columns else "from the places"
        lines.append(f"{drive.raw.rows.size} points, speed {source}")
    return "\n".join([*lines, f"repaired: {'; '.join(trip.notes)}"] if trip.notes else lines)


def draw(trip: UserTrip, path: Path) -> None:
    """Draw speed, heights and grade, raw data behind what was made of them.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    FigureCanvasAgg(figure)
    speed, height, grade = figure.subplots(3, 1)
    drive = trip.drive
    if drive is not None:
        columns = drive.raw.columns
        raw, times = columns.get("speed_m_s"), columns["time_s"]
        moments = times if raw is not None else times[1:]
        raw = (
            raw
            if raw is not None
            else steps_m(columns["latitude_deg"], columns["longitude_deg"]) / np.diff(times)
        )
        # A launch ramp in front of the trip moves it.
        shift_s = trip.cycle.duration_s - np.floor(times[-1])
        speed.plot(
            moments + max(shift_s, 0.0), KM_H_PER_M_S * raw, color="0.75", lw=0.8, label="recorded"
        )
        if "elevation_m" in columns:
            height.plot(drive.point_positions_m, columns["elevation_m"], color="0.75", lw=0.8)
    speed.plot(trip.cycle.times_s, KM_H_PER_M_S * trip.cycle.speeds_m_s, color="C0", label="driven")
    speed.set(xlabel="time [s]", ylabel="speed [km/h]")
    speed.legend(loc="upper right", frameon=False)
    if trip.slope is not None:
        positions, slopes = trip.slope.positions_m, trip.slope.slopes_rad
        grade.plot(positions, 100.0 * np.tan(slopes), color="C2")
        sines = np.sin(slopes)
        rises = 0.5 * np.diff(positions) * (sines[1:] + sines[:-1])
        climbed = np.concatenate([[0.0], np.cumsum(rises)])
        level = _level(drive, positions, climbed)
        height.plot(positions, climbed + level, color="C1")
    height.set(xlabel="position [m]", ylabel="height [m]")
    grade.set(xlabel="position [m]", ylabel="grade [%]")
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _level(drive: RecordedDrive | None, positions: FloatArray, climbed: FloatArray) -> float:
    """Return the height at which the integrated grade fits the recorded heights best, 0 without any."""
    heights = None if drive is None else drive.raw.columns.get("elevation_m")
    if drive is None or heights is None:
        return 0.0
    return float(np.mean(heights - np.interp(drive.point_positions_m, positions, climbed)))

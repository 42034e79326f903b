"""Recorded drives: shows what is read out of one, and makes an example with the noise of a phone.

drive_file show my_drive.gpx --picture my_drive.png
drive_file can my_drive.blf my_drive.csv --dbc car.dbc --signal speed_kmh=VehicleSpeed
drive_file show bags/example_us06_120s
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iptm_core.errors import IptmError, RouteError
from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_core.program import refused
from iptm_core.routes import build_route
from iptm_core.routes.can_files import CAN_SUFFIXES
from iptm_core.routes.can_log import CAN_COLUMNS, can_log_csv
from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.routes.text_table import parse_text_table
from iptm_core.routes.track import RecordedDrive, steps_m
from iptm_core.routes.user_csv import USER_FILES, UserTrip, read_user_trip, trip_of_table
from iptm_core.state import FloatArray

EXAMPLE_CYCLE = "sc03"
EXAMPLE_PLACE_DEG = (48.40, 9.98)
PLACE_NOISE_M, PLACE_CORRELATION_S, PLACE_JITTER_M = 2.5, 60.0, 0.25
HEIGHT_NOISE_M, HEIGHT_CORRELATION_S, HEIGHT_JITTER_M = 4.0, 90.0, 0.6
"""A phone's errors: they wander slowly by some metres, and jitter by less from second to second."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(
        prog="drive_file", description=(__doc__ or "").partition("\n")[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    show = commands.add_parser("show", help="what is read out of a drive")
    show.add_argument("file", type=Path, help=USER_FILES)
    show.add_argument(
        "--columns",
        default="",
        metavar="WHAT=NAME[UNIT],...",
        help="which column of a table is what: speed=Vehicle_Speed[km/h]",
    )
    show.add_argument("--picture", type=Path, help="draw it into this .png file")
    can = commands.add_parser("can", help="make a drive of signals in a CAN log, and show it")
    can.add_argument("log", type=Path, help=f"{', '.join(CAN_SUFFIXES)} file")
    can.add_argument("file", type=Path, help=".csv file to write")
    can.add_argument(
        "--dbc", type=Path, help="decodes the frames; none for an MF4 file that holds signals"
    )
    can.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="COLUMN=SIGNAL",
        help=f"what a signal is, repeatable; columns: {', '.join(CAN_COLUMNS)}",
    )
    can.add_argument(
        "--channel", default="", help="bus or sender (0x..) of the frames, where there are several"
    )
    can.add_argument("--picture", type=Path, help="draw it into this .png file")
    example = commands.add_parser(
        "example", help="make an example drive as a phone would record it"
    )
    example.add_argument("file", type=Path, help=".gpx file to write")
    example.add_argument("--seed", type=int, default=1, help="of the noise (1)")
    given = parser.parse_args(arguments)
    try:
        if given.command == "example":
            given.file.write_text(example_gpx(given.seed), encoding="utf-8")
            return 0
        if given.command == "can":
            signals = dict(map(_named_signal, given.signal))
            text = can_log_csv(given.log, given.dbc, signals, given.channel)
            trip = trip_of_table(given.file, parse_text_table(text, str(given.file)))
            given.file.write_text(text, encoding="utf-8")
        else:
            columns = f"#{given.columns}" if given.columns else ""
            trip = read_user_trip(Path(f"{given.file}{columns}"))
        print(description(trip))
        if given.picture is not None:
            draw(trip, given.picture)
    except (IptmError, OSError) as reason:
        return refused("drive_file", reason)
    return 0


def _named_signal(text: str) -> tuple[str, str]:
    column, separator, signal = text.partition("=")
    if not (column and separator and signal):
        raise RouteError(f"--signal is {text!r}; allowed: COLUMN=SIGNAL")
    return column, signal


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
        source = "of the receiver" if drive.track.speeds_m_s is not None else "from the places"
        lines.append(f"{drive.track.times_s.size} points, speed {source}")
        lines.append(f"grade bounded on {drive.bounded_m:.0f} m of the road")
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
        track = drive.track
        raw = track.speeds_m_s
        moments = track.times_s if raw is not None else track.times_s[1:]
        raw = (
            raw
            if raw is not None
            else steps_m(track.latitudes_deg, track.longitudes_deg) / np.diff(track.times_s)
        )
        # A launch ramp in front of the trip moves it.
        shift_s = trip.cycle.duration_s - np.floor(track.times_s[-1])
        speed.plot(
            moments + max(shift_s, 0.0), KM_H_PER_M_S * raw, color="0.75", lw=0.8, label="recorded"
        )
        if track.heights_m is not None:
            height.plot(drive.point_positions_m, track.heights_m, color="0.75", lw=0.8)
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
    if drive is None or drive.track.heights_m is None:
        return 0.0
    heights = drive.track.heights_m
    return float(np.mean(heights - np.interp(drive.point_positions_m, positions, climbed)))


def example_gpx(seed: int) -> str:
    """Return a drive of a published cycle on a winding, hilly road, with the errors of a phone's receiver."""
    route = build_route(EXAMPLE_CYCLE, "small", initial_gap_m=15.0)
    source = np.random.default_rng(seed)
    road = _winding_road(route.leader.positions_m[-1] + 100.0)
    seconds = np.arange(route.duration_s + 1.0)
    positions = route.leader.positions_at(seconds) - route.leader.start_position_m
    latitudes, longitudes, _ = road.locate(positions)
    fine = np.arange(0.0, positions[-1] + 1.0)
    climbed = 480.0 + np.concatenate([[0.0], np.cumsum(np.sin(route.slope.slope_at(fine)))[:-1]])
    east, north, up = (
        _wander(source, seconds.size, *noise)
        for noise in (
            (PLACE_NOISE_M, PLACE_CORRELATION_S, PLACE_JITTER_M),
            (PLACE_NOISE_M, PLACE_CORRELATION_S, PLACE_JITTER_M),
            (HEIGHT_NOISE_M, HEIGHT_CORRELATION_S, HEIGHT_JITTER_M),
        )
    )
    one_east, one_north = east_north_m(
        EXAMPLE_PLACE_DEG[0] + 1e-3, EXAMPLE_PLACE_DEG[1] + 1e-3, EXAMPLE_PLACE_DEG
    )
    heights = np.interp(positions, fine, climbed) + up
    begin = datetime(2026, 5, 4, 7, 30, tzinfo=timezone.utc)
    rows = [
        f'   <trkpt lat="{latitude:.7f}" lon="{longitude:.7f}"><ele>{height:.1f}</ele>'
        f"<time>{begin + timedelta(seconds=float(second)):%Y-%m-%dT%H:%M:%SZ}</time></trkpt>"
        for latitude, longitude, height, second in zip(
            latitudes + north * 1e-3 / float(one_north),
            longitudes + east * 1e-3 / float(one_east),
            heights,
            seconds,
            strict=True,
        )
    ]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<gpx version="1.1" creator="iptm drive_file" xmlns="http://www.topografix.com/GPX/1/1">',
            f" <trk><name>made from {EXAMPLE_CYCLE}, with the noise of a phone</name>",
            "  <trkseg>",
            *rows,
            "  </trkseg>",
            " </trk>",
            "</gpx>",
            "",
        ]
    )


def _winding_road(length_m: float) -> RoadLine:
    """Return a road with bends of a few hundred metres."""
    along = np.arange(0.0, length_m + 10.0, 10.0)
    heading = 0.6 * np.sin(along / 180.0) + 0.3 * np.sin(along / 67.0)
    one_east, one_north = east_north_m(
        EXAMPLE_PLACE_DEG[0] + 1e-3, EXAMPLE_PLACE_DEG[1] + 1e-3, EXAMPLE_PLACE_DEG
    )
    return RoadLine(
        EXAMPLE_PLACE_DEG[0] + np.cumsum(10.0 * np.cos(heading)) * 1e-3 / float(one_north),
        EXAMPLE_PLACE_DEG[1] + np.cumsum(10.0 * np.sin(heading)) * 1e-3 / float(one_east),
    )


def _wander(
    source: np.random.Generator, count: int, deviation: float, correlation_s: float, jitter: float
) -> FloatArray:
    """Return errors once a second: a first-order process and white noise on top."""
    decay = np.exp(-1.0 / correlation_s)
    shocks = deviation * np.sqrt(1.0 - decay**2) * source.standard_normal(count)
    slow = np.empty(count)
    state = deviation * source.standard_normal()
    for index in range(count):
        state = decay * state + shocks[index]
        slow[index] = state
    noisy: FloatArray = slow + jitter * source.standard_normal(count)
    return noisy


if __name__ == "__main__":
    sys.exit(main())

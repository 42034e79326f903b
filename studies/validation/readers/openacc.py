"""Platoons of OpenACC (Joint Research Centre): original files of any campaign, and compact ones.

An original file has five lines of metadata (date, order of the vehicles, number, ACC, distance setting)
before the header; vehicle ``i`` has columns ``Speed<i>``, ``IVS<i>`` (gap to the vehicle behind) and, in some
campaigns, ``Driver<i>``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from studies.validation.measurements import Drive, Driver
from studies.validation.readers.columns import compact_table, head_of, numbers, original_table

from iptm.parts import FloatArray, MeasurementError

STEP_S = 0.2
LONGEST_GAP_S = 0.45


def is_compact_openacc(head: list[str]) -> bool:
    """True for the first lines of a compact file of platoons."""
    return head[0].startswith("run,time_s,place,car,speed_m_s")


def is_original_openacc(head: list[str]) -> bool:
    """True for the first lines of a platoon as it is downloaded."""
    header = next((line for line in head if line.startswith("Time,")), "")
    return head[0].startswith("Date,") and "Speed1" in header


def _driver(place: int, *, driven_by_people: bool) -> Driver:
    # The first vehicle of a platoon follows no other one: a person sets its speed.
    return (
        Driver.PROVING_GROUND if driven_by_people or place == 1 else Driver.ADAPTIVE_CRUISE_CONTROL
    )


def _on_grid(time_s: FloatArray, speed_m_s: FloatArray) -> FloatArray:
    """Return the speeds at equal steps, NaN between samples that are further apart than 0.45 s."""
    grid = time_s[0] + STEP_S * np.arange(round((time_s[-1] - time_s[0]) / STEP_S) + 1)
    known = np.isfinite(speed_m_s)
    if known.sum() < 2:
        return np.full(len(grid), np.nan)
    times, speeds = time_s[known], speed_m_s[known]
    after = np.clip(np.searchsorted(times, grid - 1e-6), 1, len(times) - 1)
    at_sample = np.minimum(np.abs(grid - times[after - 1]), np.abs(times[after] - grid)) < 1e-6
    inside = (grid >= times[0]) & (grid <= times[-1])
    close = inside & (times[after] - times[after - 1] <= LONGEST_GAP_S)
    return np.where(at_sample | close, np.interp(grid, times, speeds), np.nan)


def compact_platoons(path: Path) -> list[Drive]:
    """Read a compact file; runs named ``no_ACC`` were driven by people."""
    names = ("run", "time_s", "place", "speed_m_s", "gap_to_car_ahead_m")
    found = []
    for run, rows in compact_table(path, names).groupby("run", sort=False):
        vehicles = {int(place): of_place for place, of_place in rows.groupby("place")}
        for place, own in vehicles.items():
            times, ahead = own.time_s.to_numpy(), vehicles.get(place - 1)
            name, by_people = f"{run}/{place}", str(run).startswith("no_ACC")
            driver = _driver(place, driven_by_people=by_people)
            speeds = _on_grid(times, own.speed_m_s.to_numpy())
            leader, gaps = None, None
            if ahead is not None and np.array_equal(times, ahead.time_s):
                leader = _on_grid(times, ahead.speed_m_s.to_numpy())
                gaps = _on_grid(times, own.gap_to_car_ahead_m.to_numpy())
            found.append(Drive(name, str(run), driver, STEP_S, speeds, leader, gaps))
    return found


def original_platoons(path: Path) -> list[Drive]:
    """Read one file as it is downloaded.

    Raises:
        MeasurementError: the time column is missing.
    """
    head = head_of(path)
    skip = next((i for i, line in enumerate(head) if line.startswith("Time,")), None)
    if skip is None:
        raise MeasurementError(f"{path.name} has no column Time within its first {len(head)} lines")
    metadata = {line.split(",")[0]: line.split(",")[1:] for line in head[:skip]}
    table = original_table(path, ["Time"], skip=skip)
    table = table[np.isfinite(numbers(table["Time"]))]
    manual = metadata.get("ACC", ["1"])[0].strip() == "0" or "no_acc" in path.parent.name.lower()
    run = f"{path.parent.name}__{path.name.split('.')[0]}"
    times = numbers(table["Time"])

    def on_grid(name: str) -> FloatArray:
        values = numbers(table[name]) if name in table else np.full(times.size, np.nan)
        return _on_grid(times, values)

    names = [name[5:] for name in table if name.startswith("Speed")]
    speeds = {int(name): on_grid(f"Speed{name}") for name in names if name.isdigit()}
    found = []
    for place, speed in speeds.items():
        name, driver = f"{run}/{place}", _original_driver(table, place, manual=manual)
        leader = speeds.get(place - 1)
        gaps = None if leader is None else on_grid(f"IVS{place - 1}")
        found.append(Drive(name, run, driver, STEP_S, speed, leader, gaps))
    return found


def _original_driver(table: pd.DataFrame, place: int, *, manual: bool) -> Driver:
    """Return who controls the speed of a vehicle; ``manual`` where the file does not name its driver."""
    if f"Driver{place}" in table:
        drivers = table[f"Driver{place}"].str.strip().str.lower()
        drivers = drivers[drivers != ""]
        if not drivers.empty:
            manual = bool((drivers == "human").mean() > 0.5)
    return _driver(place, driven_by_people=manual)

"""Platoons of OpenACC (Joint Research Centre): original files of any campaign, and compact ones.

An original file has five lines of metadata (date, order of the vehicles, number, ACC, distance setting)
before the header; vehicle ``i`` has columns ``Speed<i>``, ``IVS<i>`` (gap to the vehicle behind) and, in some
campaigns, ``Driver<i>``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iptm_core.errors import MeasurementError
from iptm_core.state import FloatArray
from iptm_validation.measurements import Drive, Driver, Following
from iptm_validation.readers.columns import compact_table, head_of, numbers, original_table

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


def compact_drives(path: Path) -> list[Drive]:
    """Read the drives of a compact file; runs named ``no_ACC`` were driven by people."""
    return [
        Drive(
            f"{run}/{place}",
            run,
            _driver(place, driven_by_people=run.startswith("no_ACC")),
            STEP_S,
            _on_grid(*(rows[name].to_numpy() for name in ("time_s", "speed_m_s"))),
        )
        for run, vehicles in _compact_runs(path, ())
        for place, rows in vehicles.items()
    ]


def compact_followings(path: Path) -> list[Following]:
    """Read lead vehicles and followers of a compact file, where platoon neighbours were both recorded."""
    found = []
    for run, vehicles in _compact_runs(path, ("gap_to_car_ahead_m",)):
        for place, rows in vehicles.items():
            ahead, times = vehicles.get(place - 1), rows.time_s.to_numpy()
            if ahead is None or not np.array_equal(times, ahead.time_s):
                continue
            columns = (ahead.speed_m_s, rows.speed_m_s, rows.gap_to_car_ahead_m)
            driver = _driver(place, driven_by_people=run.startswith("no_ACC"))
            on_grid = (_on_grid(times, column.to_numpy()) for column in columns)
            found.append(Following(f"{run}/{place}", driver, STEP_S, *on_grid))
    return found


def _compact_runs(
    path: Path, more: tuple[str, ...]
) -> Iterator[tuple[str, dict[int, pd.DataFrame]]]:
    """Yield the runs of a compact file, with the rows of each vehicle by its place."""
    table = compact_table(path, ("run", "time_s", "place", "speed_m_s", *more))
    for run, rows in table.groupby("run", sort=False):
        yield str(run), {int(place): of_place for place, of_place in rows.groupby("place")}


@dataclass(frozen=True, eq=False)
class _Original:
    """One file as it is downloaded; only rows with a time."""

    run: str
    table: pd.DataFrame
    driven_by_people: bool

    @property
    def places(self) -> list[int]:
        """Places in the platoon that have a speed."""
        names = [name[5:] for name in self.table if name.startswith("Speed")]
        return [int(name) for name in names if name.isdigit()]

    def on_grid(self, name: str) -> FloatArray:
        """Return a column at equal steps, all NaN without it."""
        time_s = numbers(self.table["Time"])
        is_there = name in self.table
        values = numbers(self.table[name]) if is_there else np.full(time_s.size, np.nan)
        return _on_grid(time_s, values)

    def driver(self, place: int) -> Driver:
        """Return who controls the speed of a vehicle."""
        by_people = self.driven_by_people
        if f"Driver{place}" in self.table:
            drivers = self.table[f"Driver{place}"].str.strip().str.lower()
            drivers = drivers[drivers != ""]
            if not drivers.empty:
                by_people = (drivers == "human").mean() > 0.5
        return _driver(place, driven_by_people=by_people)


def original_drives(path: Path) -> list[Drive]:
    """Read the drives of one file as it is downloaded.

    Raises:
        MeasurementError: the time column is missing.
    """
    file = _original(path)
    return [
        Drive(
            f"{file.run}/{place}",
            file.run,
            file.driver(place),
            STEP_S,
            file.on_grid(f"Speed{place}"),
        )
        for place in file.places
    ]


def original_followings(path: Path) -> list[Following]:
    """Read the pairs of lead vehicle and follower of one file as it is downloaded.

    Raises:
        MeasurementError: the time column is missing.
    """
    file = _original(path)
    return [
        Following(
            f"{file.run}/{place}",
            file.driver(place),
            STEP_S,
            *map(file.on_grid, (f"Speed{place - 1}", f"Speed{place}", f"IVS{place - 1}")),
        )
        for place in file.places
        if place - 1 in file.places
    ]


def _original(path: Path) -> _Original:
    head = head_of(path)
    skip = next((i for i, line in enumerate(head) if line.startswith("Time,")), None)
    if skip is None:
        raise MeasurementError(f"{path.name} has no column Time within its first {len(head)} lines")
    metadata = {line.split(",")[0]: line.split(",")[1:] for line in head[:skip]}
    table = original_table(path, ["Time"], skip=skip)
    manual = metadata.get("ACC", ["1"])[0].strip() == "0" or "no_acc" in path.parent.name.lower()
    run = f"{path.parent.name}__{path.name.split('.')[0]}"
    return _Original(run, table[np.isfinite(numbers(table["Time"]))], manual)

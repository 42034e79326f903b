"""Platoons of OpenACC (Joint Research Centre): original files of any campaign, and compact ones.

An original file has five lines of metadata (date, order of the vehicles, number, ACC, distance setting)
before the header; vehicle ``i`` has columns ``Speed<i>`` and, in some campaigns, ``Driver<i>``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from iptm_core.errors import MeasurementError
from iptm_core.state import FloatArray
from iptm_validation.measurements import Drive, Driver
from iptm_validation.readers.columns import (
    compact_columns,
    head_of,
    numbers,
    original_column,
    original_rows,
    texts,
)

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
    columns = compact_columns(path, ("run", "time_s", "place", "speed_m_s"))
    runs = np.array(texts(columns, "run"))
    places, times = numbers(columns, "place"), numbers(columns, "time_s")
    speeds = numbers(columns, "speed_m_s")
    drives = []
    for run in dict.fromkeys(runs.tolist()):
        of_run = runs == run
        for place in np.unique(places[of_run]):
            rows = of_run & (places == place)
            driver = _driver(int(place), driven_by_people=run.startswith("no_ACC"))
            values = _on_grid(times[rows], speeds[rows])
            drives.append(Drive(f"{run}/{int(place)}", run, driver, STEP_S, values))
    return drives


def original_drives(path: Path) -> list[Drive]:
    """Read the drives of one file as it is downloaded.

    Raises:
        MeasurementError: there is no time column.
    """
    head = head_of(path)
    skip = next((i for i, line in enumerate(head) if line.startswith("Time,")), None)
    if skip is None:
        raise MeasurementError(f"{path.name} has no column Time within its first {len(head)} lines")
    metadata = {line.split(",")[0]: line.split(",")[1:] for line in head[:skip]}
    header, rows = original_rows(path, ",", skip)
    time_s = original_column(rows, header.index("Time"))
    rows = [row for row, time in zip(rows, time_s, strict=True) if np.isfinite(time)]
    time_s = time_s[np.isfinite(time_s)]
    run = f"{path.parent.name}__{path.name.split('.')[0]}"
    manual = metadata.get("ACC", ["1"])[0].strip() == "0" or "no_acc" in path.parent.name.lower()
    drives = []
    for index, name in enumerate(header):
        if not (name.startswith("Speed") and name[5:].isdigit()):
            continue
        place = int(name[5:])
        by_people = manual
        if f"Driver{place}" in header:
            at = header.index(f"Driver{place}")
            drivers = [row[at].strip().lower() for row in rows if at < len(row) and row[at].strip()]
            by_people = drivers.count("human") > len(drivers) / 2 if drivers else manual
        driver = _driver(place, driven_by_people=by_people)
        values = _on_grid(time_s, original_column(rows, index))
        drives.append(Drive(f"{run}/{place}", run, driver, STEP_S, values))
    return drives

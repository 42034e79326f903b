"""Trips with a cabin in memory: the run of the suite, and a table of its cabin."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from iptm.driving import check_in_memory, drive_in_memory
from iptm.run import Run
from iptm.trip import Trip
from iptm_cabin.cabin_plant import CABIN, CabinVehicleState
from iptm_cabin.parameters import SUFFIX
from iptm_core.state import LeaderState
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.interval import PlantStep

SETTLED_S = 600.0
WARM_K = 2.0


def drive_with_cabin(
    cycle: Any, plant: str, changes: Mapping[str, Any] | None = None, **settings: Any
) -> tuple[Run, pd.DataFrame]:
    """Drive a trip as `iptm.simulate` does, and return the cabin, too.

    Args:
        plant: a file of `CabinParameters`, or the name of a car of this extra.
        changes: values that differ from the file's, by name.
        settings: of the trip.

    Returns:
        The run, and a table of CABIN with a row per tick and the time in s as its index.
    """
    if changes:
        base = Path(plant).absolute() if Path(plant).is_file() else Path(plant)
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"changed{SUFFIX}"
            path.write_text(json.dumps({"base": str(base.with_suffix("")), **changes}), "utf-8")
            return drive_with_cabin(cycle, str(path), **settings)
    trip = check_in_memory(Trip.of(cycle, plant=plant, **settings))
    rows: list[tuple[float, ...]] = []

    def note(step: PlantStep, _: LeaderState | None) -> None:
        state = step.state
        if isinstance(state, CabinVehicleState):
            rows.append((state.time_s, *(getattr(state.cabin, name) for name in CABIN)))

    run = drive_in_memory(trip, on_step=note)
    table = pd.DataFrame(rows, columns=["time_s", *CABIN], dtype=np.float64)
    return run, table.set_index("time_s")


def comfort(table: pd.DataFrame, set_point_c: float) -> Mapping[str, float]:
    """Return figures of comfort: rms of the trip, rms and mean after ten minutes, time to within 2 K.

    Temperatures are in K off the set point; the time in s is the length of the trip where it never is.
    """
    apart = table.air_k.to_numpy() - CELSIUS_ZERO_K - set_point_c
    times = table.index.to_numpy()
    late = apart[times >= SETTLED_S] if times[-1] > SETTLED_S else apart[-1:]
    near = np.flatnonzero(np.abs(apart) <= WARM_K)
    return {
        "rms_k": float(np.sqrt(np.mean(apart**2))),
        "late_rms_k": float(np.sqrt(np.mean(late**2))),
        "late_mean_k": float(np.mean(late)),
        "within_2k_s": float(times[near[0]] if near.size else times[-1]),
    }


def limited_s(table: pd.DataFrame, column: str = "is_limited") -> float:
    """Return for how long the loop was at a limit, or at another one of `CabinState` by name."""
    return float(table[column].sum() * (table.index[1] - table.index[0]))

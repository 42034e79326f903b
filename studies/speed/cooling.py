"""Whole trips with other cooling simulated after every solve, against the same trips without it.

python -m studies.speed.cooling [CYCLE ...]
"""

from __future__ import annotations

import sys
from functools import partial
from unittest import mock

import numpy as np

import iptm
from iptm_controller.solvers.interface import SolverOptions

CYCLES = ("us06", "hwfet", "wltc_class3b")


def drive(trip: iptm.Trip, *, simulates: bool) -> iptm.Run:
    """Drive a trip in memory, with or without the simulation of other cooling."""
    options = partial(SolverOptions, simulate_cooling=simulates)
    with mock.patch("iptm_controller.settings.SolverOptions", options):
        return iptm.drive(trip)


def row(cycle: str, preview: str) -> str:
    """Return what the simulation saves on a cycle, in %, and the median time of a solve, in ms."""
    trip = iptm.Trip.of(cycle, preview_mode=preview)
    without, simulated = (drive(trip, simulates=each) for each in (False, True))
    saving = simulated.saving(without)
    shares = (
        saving.energy.equal_ends_percent,
        saving.aging.equal_ends_percent,
        saving.cells.median,
    )
    times_ms = (1e3 * np.median(run.decisions.solve_time_s) for run in (simulated, without))
    figures = " | ".join([*(f"{each:.2f} %" for each in shares), *(f"{t:.2f}" for t in times_ms)])
    return f"{cycle}, preview {preview} | {figures}"


if __name__ == "__main__":
    print("trip | energy | ageing | six cells | median time of a solve with it, ms | without")
    for name in sys.argv[1:] or CYCLES:
        for mode in ("full", "none"):
            print(row(name, mode), flush=True)

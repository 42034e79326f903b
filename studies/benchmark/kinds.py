"""One law as an entrant of every kind, by both judges, and how `prices` warms a pack before a fast charge."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from studies.benchmark.driving import merged, rows_of
from studies.benchmark.entrants import BY_NAME, REFERENCE, entrant_of
from studies.benchmark.foreign import DOOR
from studies.benchmark.judge import Found, score
from studies.benchmark.library import both_judges
from studies.session import Session

import iptm
from iptm_core.state import FloatArray
from iptm_ros.discovery import middleware_settings, reserve_domain

TASKS = Path(__file__).parent / "tasks"
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
FOLLOWER = EXAMPLES / "benchmark"
TASK, LONG = "hot", "long"
PYTHON, SUITE = "Python", "`default`"
TIMEOUT_S = 900.0
LAST_S = 900.0
"""End of the long task in which the pack is warmed."""


def kinds_of(session: Session) -> list[dict[str, Any]]:
    """Return a row for each kind: cost, scores by both judges, and how far its rows are from Python's."""
    with TemporaryDirectory() as made:
        kinds = kinds_in(Path(made), iptm.load_trip(TASKS / f"{TASK}.yaml"))
        given = [*({"entrant": each.name} for each in REFERENCE), *kinds.values()]
        names = [*(each.name for each in REFERENCE), *kinds]
        trip = iptm.load_trip(TASKS / f"{TASK}.yaml")
        calls = [{"trip": trip, **each} for each in given]
        found = session.compute(by_both, calls, names, 1)
    if None in found:
        return []
    references, found = found[: len(REFERENCE)], found[len(REFERENCE) :]
    by_judge, by_library, _ = (list(each) for each in zip(*references, strict=True))
    columns = dict(zip(kinds, (each[2] for each in found), strict=True))
    return [
        {
            "kind": name,
            **vars(judged),
            "score": score(judged, by_judge)[0],
            "library": score(other, by_library)[0],
            "off": largest_difference(rows, columns[SUITE if SUITE in name else PYTHON]),
        }
        for name, (judged, other, rows) in zip(kinds, found, strict=True)
    ]


def kinds_in(folder: Path, trip: iptm.Trip) -> dict[str, dict[str, Any]]:
    """Return entrant or bag of each kind; units and bags are made in a folder."""
    python, unit = FOLLOWER / "follower.py", unit_in(folder)
    own = merged(trip, BY_NAME["default"].settings)
    node = EXAMPLES / "own_controller.py"
    return {
        PYTHON: {"entrant": f"{python}:Follower", "files": [python]},
        "C": {"entrant": str(FOLLOWER / "follower.c"), "files": [DOOR]},
        **({} if unit is None else {"FMU": {"entrant": str(unit)}}),
        "node of ROS 2, from its bag": {"bag": recorded_over_ros(trip, folder / "node", node)},
        SUITE: {"entrant": "default"},
        f"{SUITE}, from its bag": {"bag": recorded_over_ros(own, folder / "suite")},
    }


def by_both(
    trip: iptm.Trip, entrant: str = "", bag: Path | None = None, files: Sequence[Path] = ()
) -> tuple[Found, Found, Mapping[str, FloatArray]]:
    """Return what both judges find, and the rows: of a bag, or of a drive with an entrant of these files."""
    del files
    if bag is None:
        who = entrant_of(entrant)
        run = iptm.drive(merged(trip, who.settings), controller=who.controller(trip))
    else:
        run = iptm.load(bag)
    return (*both_judges(run, trip), rows_of(run.trajectory.to_arrays()))


def largest_difference(columns: Mapping[str, FloatArray], other: Mapping[str, FloatArray]) -> float:
    """Return the largest difference of rows in parts of the largest value of their column."""
    return max(
        float(np.nanmax(np.abs(columns[name] - values)) / max(np.nanmax(np.abs(values)), 1.0))
        for name, values in other.items()
    )


def unit_in(folder: Path) -> Path | None:
    """Make the FMU of the example; None where pythonfmu is not installed."""
    if find_spec("pythonfmu") is None:
        return None
    source = str(FOLLOWER / "follower_fmu.py")
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", source, "-d", str(folder)]
    subprocess.run(command, check=True, timeout=TIMEOUT_S, capture_output=True)  # noqa: S603
    return folder / "Follower.fmu"


def recorded_over_ros(trip: iptm.Trip, folder: Path, node: Path | None = None) -> Path:
    """Drive a trip over ROS 2, with a node in the place of the controller or without; return the bag."""
    folder.mkdir(parents=True)
    task, bag = folder / "trip.yaml", folder / "bag"
    task.write_text(iptm.trip_text(trip), "utf-8")
    run = [
        sys.executable,
        "-m",
        "iptm.commands.run",
        str(task),
        "--no-picture",
        "--output",
        str(bag),
    ]
    run += ["--without", "controller"] if node else []
    with reserve_domain() as domain:
        env = {**os.environ, "ROS_DOMAIN_ID": str(domain), **middleware_settings({})}
        started = node and subprocess.Popen([sys.executable, str(node)], env=env)  # noqa: S603
        try:
            # A broken limit is an exit code of 1, and is judged here.
            subprocess.run(run, env=env, timeout=TIMEOUT_S, capture_output=True, check=False)  # noqa: S603
        finally:
            if started:
                started.send_signal(signal.SIGINT)
                started.wait(TIMEOUT_S)
    return bag


def pulses_of(session: Session) -> list[dict[str, Any]]:
    """Return what `prices` does in the last minutes of the long task, with and without the fast charge."""
    trip = iptm.load_trip(TASKS / f"{LONG}.yaml")
    trips = {"with": trip, "without": trip.changed(arrival_cost_eur="")}
    calls = [{"trip": each} for each in trips.values()]
    found = session.compute(warmed, calls, [f"{LONG}, {name} the charge" for name in trips], 1)
    return [{"charge": name, **each} for name, each in zip(trips, found, strict=True) if each]


def warmed(trip: iptm.Trip) -> dict[str, float]:
    """Return heat of cells and heater, accelerations and interventions at the end of a drive of `prices`."""
    run = iptm.drive(merged(trip, BY_NAME["prices"].settings))
    rows = run.trajectory
    late = rows.time_s > rows.time_s[-1] - LAST_S
    braked = rows.service_braking_s > 0.0
    began = np.flatnonzero(braked[1:] & ~braked[:-1]) + 1
    acceleration = np.diff(rows.speed_m_s)
    return {
        "cells_mj": float(rows.battery_heat_w[late].sum() / 1e6),
        "heater_mj": float(-np.minimum(rows.compressor_power_w[late], 0.0).sum() / 1e6),
        "acceleration_m_s2": float(np.sqrt(np.mean(acceleration[late[1:]] ** 2))),
        "interventions": float(began.size),
        "first_s": float(rows.time_s[began[0]]) if began.size else np.nan,
        "end_c": float(rows.cell_1_temperature_k[-1] - 273.15),
    }

"""Drives a trip with another strategy, without ROS, and writes every row as it is computed.

The live view runs it as a process of its own: `python -m iptm_view.reference_drive < settings.yaml`. The
first line of the output is a JSON object with strategy, columns and duration, the others are JSON
arrays; of a short trip, the last one is an object with the figures of repetitions. No row is driven
where the folder of the run keeps the trajectory of that strategy.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from iptm.driving import drive_in_memory
from iptm.run import Run
from iptm.runner.run_folder import REFERENCE
from iptm.trip import Trip
from iptm.trip_settings import HOME
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import BagError, IptmError, ScenarioError
from iptm_core.metrics.saving import SHORTEST_TRIP_S, SHORTEST_WHOLE_S
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.program import EXIT_OK, LOWEST_PRIORITY, refused
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import StrictMapping
from iptm_ros.recording.trajectory_file import read_exported_trajectory

PROGRAM = "reference_drive"
COLUMNS = (
    "time_s",
    "position_m",
    "speed_m_s",
    "gap_m",
    "battery_power_w",
    "compressor_power_w",
    "cell_1_temperature_c",
    "cell_n_temperature_c",
    "capacity_loss",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
    "state_of_charge",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive the trip of the standard input; see the module.

    Returns:
        0, or 2 after a mistake in the trip.
    """
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    parser.add_argument("--strategy", choices=list(STRATEGIES), default="reference")
    parser.add_argument("--run", type=Path, metavar="FOLDER", help="of the run, where it has ended")
    parsed = parser.parse_args(arguments)
    try:
        content = parse_yaml(sys.stdin.read(), "trip", ScenarioError)
        settings = StrictMapping(content or {}, "trip", HOME).content
        own = Trip().changed(**settings)
        trip = own.against(parsed.strategy)
        header = {
            "strategy": parsed.strategy,
            "columns": COLUMNS,
            "duration_s": trip.route.duration_s,
        }
        _write(header)
        kept = None if parsed.run is None else _kept(parsed.run, parsed.strategy)
        if kept is None:
            other = drive_in_memory(
                trip, on_step=lambda *tick: _write_rows(Trajectory.from_ticks([tick]))
            )
        else:
            _write_rows(kept)
            other = None
        if own.is_lock_step and SHORTEST_TRIP_S <= own.route.duration_s < SHORTEST_WHOLE_S:
            _write_repeated(own, other or drive_in_memory(trip))
    except IptmError as error:
        return refused(PROGRAM, error)
    return EXIT_OK


def _write_repeated(own: Trip, other: Run) -> None:
    """Write the figures of a repetition of both cars, where the saving is made of them."""
    found = drive_in_memory(own).saving(other).repeated
    if found is not None:
        _write({"repeated": [asdict(each) for each in found]})


def _kept(run: Path, strategy: str) -> Trajectory | None:
    """Return the trajectory of a strategy that a run was compared with, None where it keeps none."""
    try:
        trajectory, metadata = read_exported_trajectory(run / REFERENCE)
    except BagError:
        return None
    return trajectory if metadata.get("strategy") == strategy else None


def _write_rows(run: Trajectory) -> None:
    columns = (
        run.time_s,
        run.position_m,
        run.speed_m_s,
        run.gap_m,
        run.battery_power_w,
        run.compressor_power_w,
        run.cell_1_temperature_k - CELSIUS_ZERO_K,
        run.cell_n_temperature_k - CELSIUS_ZERO_K,
        run.cell_1_capacity_loss + run.cell_n_capacity_loss,
        run.cell_1_capacity_loss,
        run.cell_n_capacity_loss,
        run.state_of_charge,
    )
    for row in np.transpose(columns).tolist():
        _write(row)


def _write(content: object) -> None:
    print(json.dumps(content), flush=True)


if __name__ == "__main__":
    os.nice(LOWEST_PRIORITY)  # below the run and its view
    sys.exit(main())

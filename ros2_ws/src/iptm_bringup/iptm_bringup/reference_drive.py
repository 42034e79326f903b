"""Drives the trip of a scenario with another strategy, without ROS, and writes every row as it is computed.

The live view runs it as a process of its own: `python -m iptm_bringup.reference_drive < scenario.yaml`. The
first line of the output is a JSON object with strategy, columns and duration, the others are JSON arrays.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from iptm_bringup.comparison import drive_other
from iptm_bringup.scenario import prepare
from iptm_bringup.scenario_files import scenario_from
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.parameters.units import CELSIUS_ZERO_K
from iptm_core.program import EXIT_OK, refused
from iptm_core.state import LeaderState
from iptm_plant_sim.plant_step import PlantStep

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
)
_NICENESS = 19
"""Lowers the priority below that of the run and of its view."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive the scenario of the standard input; see the module.

    Returns:
        0, or 2 after a mistake in the scenario.
    """
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    parser.add_argument("--strategy", choices=list(STRATEGIES), default="reference")
    parsed = parser.parse_args(arguments)
    try:
        content = parse_yaml(sys.stdin.read(), "scenario", ScenarioError)
        scenario = scenario_from(content, "scenario", "reference", Path.cwd())
        prepared = prepare(scenario)
        header = {
            "strategy": parsed.strategy,
            "columns": COLUMNS,
            "duration_s": prepared.route.duration_s,
        }
        _write(header)
        drive_other(prepared, parsed.strategy, lambda step, leader: _write(_row(step, leader)))
    except IptmError as error:
        return refused(PROGRAM, error)
    return EXIT_OK


def _row(step: PlantStep, leader: LeaderState) -> list[float]:
    state, powers = step.state, step.powers
    return [
        state.time_s,
        state.position_m,
        state.speed_m_s,
        leader.position_m - state.position_m,
        powers.battery_power_w,
        powers.compressor_power_w,
        state.cell_1_temperature_k - CELSIUS_ZERO_K,
        state.cell_n_temperature_k - CELSIUS_ZERO_K,
        state.cell_1_capacity_loss + state.cell_n_capacity_loss,
    ]


def _write(content: object) -> None:
    print(json.dumps(content), flush=True)


if __name__ == "__main__":
    os.nice(_NICENESS)
    sys.exit(main())

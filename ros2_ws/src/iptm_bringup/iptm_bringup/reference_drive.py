"""Drives the trip of a scenario with another strategy, without ROS, and writes how the battery aged as JSON.

The live view runs it as a process of its own: `python -m iptm_bringup.reference_drive < scenario.yaml`.
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
from iptm_core.program import EXIT_OK, refused

PROGRAM = "reference_drive"
_NICENESS = 19
"""Whatever drives or shows the run goes before its reference car."""


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
        run = drive_other(prepare(scenario), parsed.strategy).trajectory
    except IptmError as error:
        return refused(PROGRAM, error)
    loss = run.cell_1_capacity_loss + run.cell_n_capacity_loss
    document = {
        "strategy": parsed.strategy,
        "time_s": run.time_s.tolist(),
        "capacity_loss": loss.tolist(),
    }
    json.dump(document, sys.stdout)
    return EXIT_OK


if __name__ == "__main__":
    os.nice(_NICENESS)
    sys.exit(main())

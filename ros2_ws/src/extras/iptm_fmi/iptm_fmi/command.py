"""Write plant, controller or meter as an FMU for other programs.

iptm fmu plant plant.fmu --fmi 2
iptm fmu controller controller.fmu --strategy aging_cost_to_go --horizon 3x1+5x5
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.errors import IptmError
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.loading import parse_overrides
from iptm_core.program import EXIT_OK, refused
from iptm_fmi.controller_unit import controller_unit
from iptm_fmi.fmu_file import VERSIONS, write_fmus
from iptm_fmi.plant_unit import meter_unit, plant_unit
from iptm_fmi.unit import Unit

PROGRAM = "iptm fmu"
PLANT, CONTROLLER, METER = "plant", "controller", "meter"
BOTH = "both"


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=(__doc__ or "").partition("\n")[0])
    add = parser.add_argument
    add("what", choices=(PLANT, CONTROLLER, METER), help="what the FMU holds")
    add("file", type=Path, metavar="OUT.fmu", help="is replaced")
    add(
        "--fmi",
        default="2",
        choices=(*map(str, VERSIONS), BOTH),
        help="version of FMI; with both, OUT_fmi2.fmu and OUT_fmi3.fmu (default: %(default)s)",
    )
    add("--parameter-set", default=DEFAULT_SET, help="the car: a shipped set, or a .yaml file")
    add("--overrides", default="", help="single parameters, 'body.mass_kg=1600'")
    add("--strategy", default=DEFAULT_STRATEGY, help="of the controller (default: %(default)s)")
    add("--horizon", default=str(MULTI_HORIZON), help="of the controller (default: %(default)s)")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Write an FMU; return the exit code, 2 if something was refused."""
    given = build_parser().parse_args(arguments)
    try:
        unit = _unit(given)
        paths = _paths(given.file, given.fmi)
        write_fmus(paths, unit)
        for path in paths.values():
            print(f"{path}: {unit.text}; {path.stat().st_size / 1024.0:.0f} kB")
    except (IptmError, OSError) as reason:
        return refused(PROGRAM, reason)
    return EXIT_OK


def _paths(file: Path, fmi: str) -> dict[int, Path]:
    if fmi != BOTH:
        return {int(fmi): file}
    return {
        version: file.with_name(f"{file.stem}_fmi{version}{file.suffix}") for version in VERSIONS
    }


def _unit(given: argparse.Namespace) -> Unit:
    parameters = load_parameters(given.parameter_set, parse_overrides(given.overrides)).values
    if given.what == PLANT:
        return plant_unit(parameters)
    if given.what == METER:
        return meter_unit(parameters)
    options = ControllerOptions(
        strategy=strategy_by_name(given.strategy), horizon=Horizon.parse(given.horizon)
    )
    return controller_unit(parameters, options)

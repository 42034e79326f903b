"""Energy, temperatures and ageing of a recorded drive, or live of any vehicle whose odometry is published.

iptm meter my_drive.csv --parameter-set bmw_i3
iptm meter log.blf --dbc car.dbc --signal speed_kmh=VehicleSpeed
iptm meter --topic /odom
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.loading import parse_overrides
from iptm_core.parameters.model import ModelParameters
from iptm_core.program import EXIT_OK, refused
from iptm_core.routes.route import USER_FILES
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import FloatArray, VehicleState
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_drives.can_log import CAN_COLUMNS, read_can_log
from iptm_drives.reading import trip_of_table
from iptm_vehicle_interface.drive_meter import DriveMeter, MeterReading

PROGRAM = "iptm meter"


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=(__doc__ or "").partition("\n")[0])
    add = parser.add_argument
    add("file", nargs="?", type=Path, help=f"{USER_FILES}; or a CAN log, with --signal")
    add("--topic", default="", help="instead of a file: odometry (nav_msgs/msg/Odometry) to meter")
    add("--battery", default="battery", help="with --topic: topic of the BatteryState")
    add("--dbc", type=Path, help="of a CAN log: how its frames are decoded")
    add(
        "--signal",
        action="append",
        default=[],
        metavar="COLUMN=SIGNAL",
        help=f"of a CAN log, repeatable; columns: {', '.join(CAN_COLUMNS)}",
    )
    add("--parameter-set", default=DEFAULT_SET, help="the car: a shipped set, or a .yaml file")
    add("--overrides", default="", help="single parameters, 'body.mass_kg=1600'")
    add("--consumers-w", type=float, default=0.0, help="heater, air conditioning and others, mean")
    add("--cell-temperature-c", type=float, help="at the start (default: the car's)")
    add(
        "--follow",
        default="",
        metavar="STRATEGY",
        help="drive behind this drive in memory, too, and show what that needs",
    )
    add("--json", action="store_true", help="print the figures as JSON")
    return parser


def metered(
    trip: UserTrip,
    parameters: ModelParameters,
    consumers_w: float = 0.0,
    cell_temperature_k: float | None = None,
) -> MeterReading:
    """Return what a recorded drive has needed; a ramp that was put in front of it is left out."""
    cycle, slope = trip.cycle, trip.slope
    times, speeds = np.asarray(cycle.times_s), np.asarray(cycle.speeds_m_s)
    first = int(np.searchsorted(times, trip.launch_s))
    moved = np.diff(times) * 0.5 * (speeds[1:] + speeds[:-1])
    start_m = float(moved[:first].sum())

    def slope_at(driven_m: float) -> float:
        if slope is None:
            return 0.0
        return float(np.interp(start_m + driven_m, slope.positions_m, slope.slopes_rad))

    meter = DriveMeter(parameters, slope_at, cell_temperature_k)
    for time_s, speed_m_s in zip(times[first:].tolist(), speeds[first:].tolist(), strict=True):
        meter.take(time_s, speed_m_s, consumers_w)
    return meter.reading


def figures(reading: MeterReading) -> dict[str, float]:
    """Return the figures of a drive, by name with unit."""
    state = reading.state
    km = state.position_m / 1000.0
    kwh = reading.battery_energy_j / J_PER_KWH
    return {
        "duration_s": reading.driven_s,
        "distance_km": km,
        "battery_energy_kwh": kwh,
        "consumption_kwh_100km": 100.0 * kwh / km if km else float("nan"),
        "traction_energy_kwh": reading.traction_energy_j / J_PER_KWH,
        "cooling_energy_kwh": reading.cooling_energy_j / J_PER_KWH,
        "recovered_energy_kwh": reading.recovered_energy_j / J_PER_KWH,
        "cell_1_temperature_c": state.cell_1_temperature_k - CELSIUS_ZERO_K,
        "cell_n_temperature_c": state.cell_n_temperature_k - CELSIUS_ZERO_K,
        "capacity_loss_ppm": 1e6 * reading.capacity_loss,
        "left_out_s": reading.left_out_s,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Meter a drive; return the exit code."""
    given = build_parser().parse_args(arguments)
    try:
        if bool(given.topic) == (given.file is not None):
            raise ScenarioError("give a file or --topic; allowed: one of both")
        if given.follow and given.consumers_w:
            raise ScenarioError(
                "--follow compares without other consumers; allowed: --consumers-w without it"
            )
        parameters = load_parameters(given.parameter_set, parse_overrides(given.overrides)).values
        kelvin = None
        if given.cell_temperature_c is not None:
            kelvin = given.cell_temperature_c + CELSIUS_ZERO_K
        if given.topic:
            meter = DriveMeter(parameters, cell_temperature_k=kelvin)
            topic = import_module("iptm_vehicle_interface.node_meter")
            code: int = topic.follow(meter, given.topic, given.battery, given.consumers_w)
            return code
        trip = _trip(given)
        found = {
            given.file.name: figures(metered(trip, parameters, given.consumers_w, kelvin)),
        }
        if given.follow:
            found[f"behind it, {given.follow}"] = _following(trip, given, kelvin)
    except (IptmError, OSError) as reason:
        return refused(PROGRAM, reason)
    if given.json:
        print(json.dumps(found))
    else:
        Console().print(_table(found))
    return EXIT_OK


def _trip(given: argparse.Namespace) -> UserTrip:
    if not given.signal:
        return read_user_trip(given.file)
    signals = {}
    for text in given.signal:
        column, separator, signal = text.partition("=")
        if not (column and separator and signal):
            raise ScenarioError(f"--signal is {text!r}; allowed: COLUMN=SIGNAL")
        signals[column] = signal
    return trip_of_table(given.file, read_can_log(given.file, given.dbc, signals))


def _following(
    trip: UserTrip, given: argparse.Namespace, cell_temperature_k: float | None
) -> dict[str, float]:
    """Return the figures of the suite behind the drive, over the same time."""
    from iptm import Trip, drive  # noqa: PLC0415

    overrides = parse_overrides(given.overrides)
    if cell_temperature_k is not None:
        overrides["environment.initial_cell_temperature_k"] = cell_temperature_k
    run = drive(
        Trip.of(
            trip,
            strategy=given.follow,
            parameter_set=given.parameter_set,
            overrides=overrides,
        )
    )
    driven = run.trajectory
    tick_s = float(driven.time_s[1] - driven.time_s[0])

    def energy_j(power_w: FloatArray) -> float:
        return tick_s * float(np.sum(power_w[1:]))

    end = VehicleState(
        float(driven.time_s[-1]),
        float(driven.position_m[-1] - driven.position_m[0]),
        float(driven.speed_m_s[-1]),
        0.0,
        0.0,
        float(driven.cell_1_temperature_k[-1]),
        float(driven.cell_n_temperature_k[-1]),
        float(driven.cell_1_capacity_loss[-1]),
        float(driven.cell_n_capacity_loss[-1]),
    )
    return figures(
        MeterReading(
            end,
            float(driven.time_s[-1] - driven.time_s[0]),
            energy_j(driven.battery_power_w),
            energy_j(driven.traction_power_w),
            run.metrics.cooling_energy_j,
            energy_j(np.maximum(-driven.battery_power_w, 0.0)),
            run.metrics.degradation,
        )
    )


def _table(found: dict[str, dict[str, float]]) -> Table:
    table = Table("figure", *found)
    for name in next(iter(found.values())):
        values = (f"{each.get(name, float('nan')):.4g}" for each in found.values())
        table.add_row(name, *values)
    return table


if __name__ == "__main__":
    sys.exit(main())

"""The meter against batteries that were measured, and against an own computation on a public log."""

from __future__ import annotations

import gzip
import io
import json
import math
import re
import shutil
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from studies.session import Session
from studies.validation import excerpts
from studies.validation.excerpts import Trip
from studies.validation.i3_drivetrain import consumers_w
from studies.validation.i3_vehicle import road_slope_rad
from studies.vehicle.bench import FRAMES, drive, kept

from iptm import meter
from iptm.drive_meter import DriveMeter
from iptm.parts import FloatArray, MeasurementError, held_out, load_parameters
from iptm_vehicle_interface.vehicle import VEHICLES, load_vehicle

I3 = Path(__file__).parents[1] / "validation" / "parameters" / "bmw_i3_vehicle.yaml"
SPEED_SIGNAL = "SPEED"
_SPEED_FRAME, _SPEED_M_S = 0x0D1, 0.0155168902
"""Identifier of the frame with the speed in its first two bytes, and the metres per second of a bit."""
_LINE = re.compile(r"\((\d+\.\d+)\) \S+ ([0-9A-Fa-f]+)#([0-9A-Fa-f]*)")


def i3_trips(path: Path) -> pd.DataFrame:
    """Meter the recorded trips of a BMW i3; return name, season, use in the fit, and error of each.

    The meter gets speed, slope, measured consumers, the air, and in winter the fitted rolling resistance.
    """
    trips = excerpts.trips(path)
    kept_back = held_out([trip.name for trip in trips])
    winter = float(yaml.safe_load(I3.read_text("utf-8"))["parameters"]["rolling_winter"])
    return pd.DataFrame(
        {
            "trip": trip.name,
            "season": "winter" if trip.is_winter else "summer",
            "fitted": trip.name not in kept_back,
            "error": _i3_error(trip, winter),
        }
        for trip in trips
    )


def _i3_error(trip: Trip, rolling_winter: float) -> float:
    ambient_k, height_m = float(np.mean(trip.ambient_k)), float(np.mean(trip.elevation_m))
    overrides = {
        "body.air_density_kg_m3": 101325.0 * np.exp(-height_m / 8400.0) / (287.05 * ambient_k)
    }
    if trip.is_winter:
        overrides["body.rolling_resistance"] = rolling_winter
    parameters = load_parameters("bmw_i3", overrides).values
    steps_s = np.diff(trip.time_s)
    means = 0.5 * (trip.speed_m_s[1:] + trip.speed_m_s[:-1])
    places = np.concatenate([[0.0], np.cumsum(means * steps_s)])
    slopes = road_slope_rad(trip)
    drive_meter = DriveMeter(
        parameters,
        lambda at_m: float(np.interp(at_m, places, slopes)),
        float(trip.battery_temperature_k[0]),
    )
    rows = zip(trip.time_s.tolist(), trip.speed_m_s.tolist(), consumers_w(trip), strict=True)
    for time_s, speed_m_s, consumed_w in rows:
        drive_meter.take(time_s, speed_m_s, float(consumed_w))
    measured_j = float(np.sum(trip.battery_power_w[1:] * steps_s))
    return drive_meter.reading.battery_energy_j / measured_j - 1.0


def shadow(log: Path, dbc: Path, signal: str, parameter_set: str, strategy: str) -> dict[str, Any]:
    """Return what `iptm meter` states of a logged drive (driven_) and of the suite behind it (behind_)."""
    options = {"--dbc": dbc, "--signal": signal, "--parameter-set": parameter_set}
    texts = [f"{part}" for pair in options.items() for part in pair]
    printed = io.StringIO()
    with redirect_stdout(printed):
        meter.main([str(log), *texts, "--follow", strategy, "--json"])
    driven, behind = json.loads(printed.getvalue()).values()
    return {f"driven_{name}": value for name, value in driven.items()} | {
        f"behind_{name}": value for name, value in behind.items()
    }


def bench_shadows(session: Session, recorded: Path, strategy: str) -> list[dict[str, Any]]:
    """Drive in shadow of the bench car's driver, with all processes, and of the log of a drive.

    Raises:
        MeasurementError: a request has reached the car.
    """
    folder = session.scratch / "drives" / "us06_shadow"
    live = kept(
        folder / "result.json",
        partial(drive, folder, "us06", strategy, 600.0, shadow=True),
    )
    if live["car"]["active_s"]:
        raise MeasurementError(f"{folder}: a request has reached the car; allowed: none in shadow")
    vehicle = load_vehicle("bench")
    rows = []
    for name, of in (("bench car's driver", folder), ("bench, by the suite", recorded)):
        found = kept(
            of / "shadow.json",
            partial(shadow, of / FRAMES, VEHICLES / "bench" / "bench.dbc",
                    "speed_kmh=VehicleSpeed", vehicle.parameter_set, strategy),
        )  # fmt: skip
        drove = json.loads((of / "result.json").read_text("utf-8"))
        own = {
            "own_kwh": drove["car"]["battery_energy_j"] / 3.6e6,
            "own_km": drove["car"]["distance_m"] / 1000.0,
            "decisions": drove["suite"]["decisions"],
        }
        rows.append({"drive": name, **found, **own})
    return rows


def public_log(session: Session, folder: Path, strategy: str) -> dict[str, Any]:
    """Drive in shadow of a public log of a car's bus, and compute its energy once more without the suite."""
    log = session.scratch / "brz.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    with gzip.open(folder / "brz_candump.log.gz") as packed, log.open("wb") as plain:
        shutil.copyfileobj(packed, plain)
    found = shadow(log, folder / "brz.dbc", f"speed_m_s={SPEED_SIGNAL}", "bmw_i3", strategy)
    times, speeds = _speeds_by_hand(log)
    own_m = float(np.sum(0.5 * np.diff(times) * (speeds[1:] + speeds[:-1])))
    return {
        "drive": "public log",
        "decisions": math.nan,
        **found,
        "own_kwh": _energy_by_hand(times, speeds) / 3.6e6,
        "own_km": own_m / 1000.0,
    }


def _speeds_by_hand(log: Path) -> tuple[FloatArray, FloatArray]:
    """Return times and speeds of a log without a library for it."""
    rows = [
        (float(found[1]), int.from_bytes(bytes.fromhex(found[3])[:2], "little") * _SPEED_M_S)
        for line in log.read_text("ascii").splitlines()
        if (found := _LINE.match(line)) and int(found[2], 16) == _SPEED_FRAME
    ]
    times, speeds = np.array(rows).T
    return times - times[0], speeds


def _energy_by_hand(times: FloatArray, speeds: FloatArray) -> float:
    """Return the battery energy of an i3 on a flat road with one efficiency, by sums over a second each.

    1578 kg, c_w A of 0.492 m^2, rolling resistance 0.0072, air of 1.204 kg/m^3, inertia of the wheels 3 %,
    83 % from the battery to the wheels and back, 450 W of auxiliaries.
    """
    grid = np.arange(0.0, times[-1], 1.0)
    at = np.interp(grid, times, speeds)
    mean = 0.5 * (at[1:] + at[:-1])
    force = 1578.0 * 9.81 * 0.0072 + 0.5 * 1.204 * 0.492 * mean**2 + 1.03 * 1578.0 * np.diff(at)
    wheel_w = np.where(mean > 0.1, force * mean, 0.0)
    power_w = np.where(wheel_w > 0.0, wheel_w / 0.83, 0.83 * wheel_w)
    return float(np.sum(np.maximum(power_w, -51e3) + 450.0))

"""The excerpts of public measurements beside this study: trips, drives and tests in SI units, by name."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iptm_core.declaration import TextEnum
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

DATA = Path(__file__).parent / "data"
OPENACC_STEP_S = 0.2
LONGEST_GAP_S = 0.45
THINNED_S = 1.6
"""Samples of a cell test further apart than this have been thinned out."""


class Driver(TextEnum):
    """Who controls the speed in a recorded drive."""

    ADAPTIVE_CRUISE_CONTROL = "adaptive_cruise_control"
    PROVING_GROUND = "proving_ground"
    ROAD = "road"


@dataclass(frozen=True, eq=False)
class Trip:
    """A trip of the BMW i3 at about 1 Hz; all arrays have shape (n,), missing values are NaN.

    Attributes:
        name: ``A..`` for a summer trip, ``B..`` for a winter trip.
        time_s: time since the start of the recording.
        speed_m_s: vehicle speed.
        elevation_m: height above sea level.
        motor_torque_nm: motor torque, negative when braking.
        voltage_v: battery voltage.
        current_a: battery current, positive when discharging.
        battery_temperature_k: pack temperature, in steps of a kelvin.
        charge: state of charge, 0 to 1.
        heating_w: electric power of the cabin heater as recorded, which is wrong in some trips.
        cooling_w: electric power of the air conditioning.
        ambient_k: temperature of the air outside.
        heat_exchanger_k: temperature of the cabin heat exchanger.
    """

    name: str
    time_s: FloatArray
    speed_m_s: FloatArray
    elevation_m: FloatArray
    motor_torque_nm: FloatArray
    voltage_v: FloatArray
    current_a: FloatArray
    battery_temperature_k: FloatArray
    charge: FloatArray
    heating_w: FloatArray
    cooling_w: FloatArray
    ambient_k: FloatArray
    heat_exchanger_k: FloatArray

    @property
    def is_winter(self) -> bool:
        """True for the winter trips."""
        return self.name.startswith("B")

    @property
    def battery_power_w(self) -> FloatArray:
        """Power at the battery terminals, positive when discharging."""
        return self.voltage_v * self.current_a


@dataclass(frozen=True, eq=False)
class Drive:
    """Speed of one vehicle at equal steps.

    Attributes:
        name: unique name.
        run: recording it belongs to; vehicles of one platoon share it.
        driver: who controls the speed.
        step_s: sampling interval.
        speed_m_s: speeds, shape (n,), NaN where nothing was recorded.
        leader_speed_m_s: speeds of the vehicle ahead, shape (n,); None without one.
        gap_m: gap between both from bumper to bumper, shape (n,), NaN where it is not known.
    """

    name: str
    run: str
    driver: Driver
    step_s: float
    speed_m_s: FloatArray
    leader_speed_m_s: FloatArray | None = None
    gap_m: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class CellTest:
    """A test of one cell; all arrays have shape (n,).

    Attributes:
        name: for example ``25degC_US06``.
        chamber_k: temperature of the chamber.
        time_s: time, increasing, from the first current on.
        current_a: current, positive when discharging.
        mean_current_a: mean current since the previous sample.
        voltage_v: terminal voltage.
        discharged_ah: charge drawn since the cell was full.
        case_temperature_k: temperature of the case.
    """

    name: str
    chamber_k: float
    time_s: FloatArray
    current_a: FloatArray
    mean_current_a: FloatArray
    voltage_v: FloatArray
    discharged_ah: FloatArray
    case_temperature_k: FloatArray


@functools.cache
def trips() -> tuple[Trip, ...]:
    """Return the trips of the BMW i3."""
    table = pd.read_csv(DATA / "bmw_i3_1hz.csv.gz", float_precision="round_trip")
    return tuple(_trip(str(name), rows) for name, rows in table.groupby("trip"))


def _trip(name: str, raw: pd.DataFrame) -> Trip:
    def get(column: str) -> FloatArray:
        """Return a channel with linearly filled gaps; one without any value stays NaN."""
        return np.array(raw[column].interpolate(limit_direction="both"), dtype=np.float64)

    return Trip(
        name=name,
        time_s=np.array(raw.time_s - raw.time_s.iloc[0]),
        speed_m_s=np.maximum(get("speed_km_h"), 0.0) / 3.6,
        elevation_m=get("elevation_m"),
        motor_torque_nm=get("motor_torque_nm"),
        voltage_v=get("battery_voltage_v"),
        current_a=-get("battery_current_a"),
        battery_temperature_k=get("battery_temperature_c") + CELSIUS_ZERO_K,
        charge=np.array(raw.soc_percent / 100.0, dtype=np.float64),
        heating_w=1000.0 * np.array(raw.heating_power_kw.fillna(0.0), dtype=np.float64),
        cooling_w=1000.0 * np.array(raw.aircon_power_kw.fillna(0.0), dtype=np.float64),
        ambient_k=get("ambient_temperature_c") + CELSIUS_ZERO_K,
        heat_exchanger_k=get("heat_exchanger_temperature_c") + CELSIUS_ZERO_K,
    )


@functools.cache
def drives() -> tuple[Drive, ...]:
    """Return the speeds of the trips at steps of a second, and the platoons of OpenACC.

    The first vehicle of a platoon follows no other one, so a person sets its speed, as in the runs named
    ``no_ACC``.
    """
    found = []
    for trip in trips():
        grid = np.arange(0.0, trip.time_s[-1], 1.0)
        speeds = np.interp(grid, trip.time_s, trip.speed_m_s)
        found.append(Drive(trip.name, trip.name, Driver.ROAD, 1.0, speeds))
    table = pd.read_csv(DATA / "openacc_5hz.csv.gz", float_precision="round_trip")
    for run, rows in table.groupby("run", sort=False):
        vehicles = {int(place): of_place for place, of_place in rows.groupby("place")}
        for place, own in vehicles.items():
            times, ahead = own.time_s.to_numpy(), vehicles.get(place - 1)
            by_hand = place == 1 or str(run).startswith("no_ACC")
            driver = Driver.PROVING_GROUND if by_hand else Driver.ADAPTIVE_CRUISE_CONTROL
            leader, gaps = None, None
            if ahead is not None and np.array_equal(times, ahead.time_s):
                leader = _on_grid(times, ahead.speed_m_s.to_numpy())
                gaps = _on_grid(times, own.gap_to_car_ahead_m.to_numpy())
            speeds = _on_grid(times, own.speed_m_s.to_numpy())
            found.append(
                Drive(f"{run}/{place}", str(run), driver, OPENACC_STEP_S, speeds, leader, gaps)
            )
    return tuple(found)


def _on_grid(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return values at equal steps, NaN between samples that are further apart than 0.45 s."""
    steps = round((time_s[-1] - time_s[0]) / OPENACC_STEP_S)
    grid = time_s[0] + OPENACC_STEP_S * np.arange(steps + 1)
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(len(grid), np.nan)
    times, values = time_s[known], values[known]
    after = np.clip(np.searchsorted(times, grid - 1e-6), 1, len(times) - 1)
    at_sample = np.minimum(np.abs(grid - times[after - 1]), np.abs(times[after] - grid)) < 1e-6
    inside = (grid >= times[0]) & (grid <= times[-1])
    close = inside & (times[after] - times[after - 1] <= LONGEST_GAP_S)
    return np.where(at_sample | close, np.interp(grid, times, values), np.nan)


def cell_tests() -> list[CellTest]:
    """Return the tests of the Panasonic cell, each from its first current on."""
    table = pd.read_csv(DATA / "panasonic_18650pf.csv.gz", float_precision="round_trip")
    found = []
    for name, rows in table.groupby("test", sort=False):
        start = max(int(np.argmax(rows.current_a.abs().to_numpy() > 0.02)) - 1, 0)
        time_s, voltage_v, current_a, charge_ah, case_c = (
            rows[column].to_numpy(dtype=np.float64)[start:]
            for column in ("time_s", "voltage_v", "current_a", "charge_ah", "cell_temperature_c")
        )
        step_s = np.diff(time_s, prepend=time_s[0])
        drawn_c = 3600.0 * -np.diff(charge_ah, prepend=charge_ah[0])
        degrees = float(str(name).split("degC")[0].replace("n", "-"))
        found.append(
            CellTest(
                name=str(name),
                chamber_k=degrees + CELSIUS_ZERO_K,
                time_s=time_s - time_s[0],
                current_a=-current_a,
                # Where samples were left out, the charge counter has the mean current between them.
                mean_current_a=np.where(
                    step_s > THINNED_S, drawn_c / np.maximum(step_s, 1e-3), -current_a
                ),
                voltage_v=voltage_v,
                discharged_ah=charge_ah[0] - charge_ah,
                case_temperature_k=case_c + CELSIUS_ZERO_K,
            )
        )
    return found

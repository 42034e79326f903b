"""Trips of a BMW i3: "Battery and Heating Data in Real Driving Cycles" (TU Munich), original and compact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from studies.validation.measurements import Trip
from studies.validation.readers.columns import block_means, compact_table, numbers, original_table

from iptm.parts import CELSIUS_ZERO_K, FloatArray, MeasurementError

# Name in the compact file -> start of the column name in the original, which may end in stray brackets.
COLUMNS = {
    "time_s": "Time [s]",
    "speed_km_h": "Velocity [km/h]",
    "elevation_m": "Elevation [m]",
    "motor_torque_nm": "Motor Torque [Nm]",
    "battery_voltage_v": "Battery Voltage [V]",
    "battery_current_a": "Battery Current [A]",
    "battery_temperature_c": "Battery Temperature [",
    "soc_percent": "SoC [%]",
    "heating_power_kw": "Heating Power CAN [kW]",
    "aircon_power_kw": "AirCon Power [kW]",
    "ambient_temperature_c": "Ambient Temperature [",
    "heat_exchanger_temperature_c": "Heat Exchanger Temperature [",
}
OPTIONAL = {"soc_percent", "heating_power_kw", "aircon_power_kw", "heat_exchanger_temperature_c"}


def _trip(name: str, raw: pd.DataFrame) -> Trip:
    def get(column: str) -> FloatArray:
        """Return a channel with linearly filled gaps; one without any value stays NaN."""
        return np.array(raw[column].interpolate(limit_direction="both"), dtype=np.float64)

    return Trip(
        name=name,
        time_s=np.array(raw["time_s"] - raw["time_s"].iloc[0]),
        speed_m_s=np.maximum(get("speed_km_h"), 0.0) / 3.6,
        elevation_m=get("elevation_m"),
        motor_torque_nm=get("motor_torque_nm"),
        voltage_v=get("battery_voltage_v"),
        current_a=-get("battery_current_a"),
        battery_temperature_k=get("battery_temperature_c") + CELSIUS_ZERO_K,
        charge=np.array(raw["soc_percent"] / 100.0, dtype=np.float64),
        heating_w=1000.0 * np.array(raw["heating_power_kw"].fillna(0.0), dtype=np.float64),
        cooling_w=1000.0 * np.array(raw["aircon_power_kw"].fillna(0.0), dtype=np.float64),
        ambient_k=get("ambient_temperature_c") + CELSIUS_ZERO_K,
        heat_exchanger_k=get("heat_exchanger_temperature_c") + CELSIUS_ZERO_K,
    )


def is_compact_i3(head: list[str]) -> bool:
    """True for the first lines of a compact file of trips."""
    return head[0].startswith("trip,time_s,speed_km_h")


def is_original_i3(head: list[str]) -> bool:
    """True for the first lines of a trip as it is downloaded."""
    return ";" in head[0] and "Velocity [km/h]" in head[0]


def compact_trips(path: Path) -> list[Trip]:
    """Read all trips of a compact file."""
    table = compact_table(path, ("trip", *COLUMNS))
    return [_trip(str(name), rows) for name, rows in table.groupby("trip", sort=False)]


def original_trips(path: Path) -> list[Trip]:
    """Read one trip as it is downloaded (``TripA01.csv``, 10 Hz) as means over a second.

    Raises:
        MeasurementError: a needed column is missing.
    """
    table = original_table(path, [COLUMNS["time_s"]], ";")
    times = numbers(table[COLUMNS["time_s"]])
    known = np.isfinite(times)  # the originals end in rows without a time
    if known.sum() < 2:
        raise MeasurementError(
            f"{path.name} has {known.sum()} rows with a time; allowed: at least 2"
        )
    size = max(round(1.0 / float(np.median(np.diff(times[known])))), 1)
    raw = {}
    for column, start in COLUMNS.items():
        name = next((name for name in table if name.startswith(start)), None)
        if name is None and column not in OPTIONAL:
            raise MeasurementError(f"{path.name} lacks the column {start!r}")
        values = np.full(len(times), np.nan) if name is None else numbers(table[name])
        raw[column] = block_means(values[known], size)
    return [_trip(path.name.split(".")[0].removeprefix("Trip"), pd.DataFrame(raw))]

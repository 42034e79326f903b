"""Trips of a BMW i3: "Battery and Heating Data in Real Driving Cycles" (TU Munich), original and compact."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from iptm_core.errors import MeasurementError
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_validation.measurements import Trip
from iptm_validation.readers.columns import (
    block_means,
    compact_columns,
    numbers,
    original_column,
    original_rows,
    texts,
)

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
OPTIONAL = {
    "soc_percent",
    "heating_power_kw",
    "aircon_power_kw",
    "heat_exchanger_temperature_c",
}


def _filled(values: FloatArray) -> FloatArray:
    """Fill gaps linearly; a channel without any value stays NaN."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    index = np.arange(len(values))
    filled: FloatArray = np.interp(index, index[known], values[known])
    return filled


def _trip(name: str, raw: dict[str, FloatArray]) -> Trip:
    def get(column: str) -> FloatArray:
        return _filled(raw[column])

    return Trip(
        name=name,
        time_s=raw["time_s"] - raw["time_s"][0],
        speed_m_s=np.maximum(get("speed_km_h"), 0.0) / 3.6,
        elevation_m=get("elevation_m"),
        motor_torque_nm=get("motor_torque_nm"),
        voltage_v=get("battery_voltage_v"),
        current_a=-get("battery_current_a"),
        battery_temperature_k=get("battery_temperature_c") + CELSIUS_ZERO_K,
        charge=raw["soc_percent"] / 100.0,
        heating_w=1000.0 * np.nan_to_num(raw["heating_power_kw"]),
        cooling_w=1000.0 * np.nan_to_num(raw["aircon_power_kw"]),
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
    columns = compact_columns(path, ("trip", *COLUMNS))
    names = np.array(texts(columns, "trip"))
    values = {column: numbers(columns, column) for column in COLUMNS}
    trips = []
    for name in dict.fromkeys(names.tolist()):
        rows = names == name
        trips.append(_trip(name, {column: array[rows] for column, array in values.items()}))
    return trips


def original_trips(path: Path) -> list[Trip]:
    """Read one trip as it is downloaded (``TripA01.csv``, 10 Hz) as means over a second.

    Raises:
        MeasurementError: a needed column is missing.
    """
    header, rows = original_rows(path, ";", 0)
    times = original_column(rows, header.index(COLUMNS["time_s"]))
    # The originals end in rows without a time.
    rows = [row for row, time in zip(rows, times, strict=True) if np.isfinite(time)]
    times = times[np.isfinite(times)]
    if len(times) < 2:
        raise MeasurementError(
            f"{path.name} has {len(times)} rows with a time; allowed: at least 2"
        )
    size = max(round(1.0 / float(np.median(np.diff(times)))), 1)
    raw = {}
    for column, start in COLUMNS.items():
        at = next((i for i, name in enumerate(header) if name.startswith(start)), None)
        if at is None and column not in OPTIONAL:
            raise MeasurementError(f"{path.name} lacks the column {start!r}")
        values = np.full(len(rows), np.nan) if at is None else original_column(rows, at)
        raw[column] = block_means(values, size)
    return [_trip(path.name.split(".")[0].removeprefix("Trip"), raw)]

"""The reference page of cars and cells, with the model's figures beside the measured ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import iptm
from iptm_core.markdown import render_page
from iptm_core.parameters import load_parameters
from iptm_core.parameters.catalogue import CHARGING_EFFICIENCY, FITTED_CAR, cars, cells
from iptm_core.parameters.model import CellParameters
from iptm_core.physics.cell import cell_resistance_ohm
from iptm_core.routes.cycles import load_cycle
from iptm_core.units import CELSIUS_ZERO_K
from iptm_vehicle_interface.drive_meter import DriveMeter

_ROOM_K = CELSIUS_ZERO_K + 24.0
_AIR = {
    "environment.ambient_temperature_k": _ROOM_K,
    "environment.initial_cell_temperature_k": _ROOM_K,
}
# Means of the list's tests of the cars whose sets are files.
_MEASURED = {"chevrolet_bolt": (118, 140), "tesla_model_3": (114, 121)}
_CYCLES = ("udds", "hwfet")
_BESIDE = {
    "automotive_60ah": FITTED_CAR,
    "lg_e78": "automotive_60ah",
    "nca_18650_3ah": "panasonic_ncr18650pf",
    "panasonic_ncr18650pf": "nca_18650_3ah",
}
"""Cell of another source that a resistance is compared with, by capacity."""
_FILE = "see [parameters](parameters.md)"


def consumption_wh_km(name: str, cycle: str) -> float:
    """Return what a car draws from the grid per distance on a cycle, in the model."""
    meter = DriveMeter(load_parameters(name, _AIR).values)
    drive = load_cycle(cycle)
    for time_s, speed_m_s in zip(drive.times_s, drive.speeds_m_s, strict=True):
        meter.take(float(time_s), float(speed_m_s))
    reading = meter.reading
    return reading.battery_energy_j / 3.6 / reading.state.position_m / CHARGING_EFFICIENCY


def car_rows() -> list[dict[str, Any]]:
    """Return the cars, each with its measured consumption and the error of the model."""
    rows = []
    for name in sorted({FITTED_CAR, *_MEASURED, *cars()}):
        loaded = load_parameters(name)
        pack, car = loaded.values.pack, cars().get(name)
        measured = _MEASURED.get(name) if car is None else (car.udds_wh_km, car.hwfet_wh_km)
        row: dict[str, Any] = {
            "name": name,
            "car": loaded.description.partition(",")[0] if car is None else car.car,
            "mass": loaded.values.body.mass_kg,
            "pack": f"{pack.cells_in_series}s{pack.parallel}p",
            "source": _FILE if car is None else car.source,
        }
        for index, cycle in enumerate(_CYCLES):
            model = consumption_wh_km(name, cycle)
            error = (
                "" if measured is None else f" ({100.0 * (model / measured[index] - 1.0):+.0f} %)"
            )
            row[cycle] = "-" if measured is None else f"{measured[index]:.0f}"
            row[f"{cycle}_model"] = f"{model:.0f}{error}"
        rows.append(row)
    return rows


def cell_rows() -> list[dict[str, Any]]:
    """Return the cells with their resistances, and the ones of other sources per capacity."""
    models = {name: _cell(iptm.Vehicle(FITTED_CAR, cell=name)) for name in cells()}
    models[FITTED_CAR] = _cell(iptm.Vehicle(FITTED_CAR))
    rows = []
    for name, cell in cells().items():
        other = models[_BESIDE[name]]
        size = other.nominal_capacity_ah / cell.capacity_ah
        celsius = {"minus_10": -10.0, "zero": 0.0, "warm": 25.0}
        rows.append(
            {
                "name": name,
                "cell": cell.cell,
                "heat": cell.heat_capacity_j_k,
                "source": cell.source,
                "beside": f"{size * _milliohm(other, 25.0):.2f} (`{_BESIDE[name]}`)",
                **{key: _milliohm(models[name], each) for key, each in celsius.items()},
            }
        )
    return rows


def _cell(vehicle: iptm.Vehicle) -> CellParameters:
    return load_parameters(vehicle.name, vehicle.overrides).values.cell


def _milliohm(cell: CellParameters, celsius: float) -> float:
    return float(1000.0 * cell_resistance_ohm(celsius + CELSIUS_ZERO_K, 0.0, cell))


def cars_page() -> str:
    """Cars and cells by name, with sources and checks."""
    return render_page(
        Path(__file__).parent / "templates",
        "cars.md.j2",
        cars=car_rows(),
        cells=cell_rows(),
        charging=CHARGING_EFFICIENCY,
    )

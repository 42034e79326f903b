"""Cars and cells by name, and the parameters that follow from their published data.

Data of a car are the EPA's road load, weight and gearing, its pack and the rated figures of its motor; of a
cell capacity, resistance with temperature, heat capacity and voltage. What is not public is scaled from a
set that was fitted, and marked as derived: the shape of the voltage over the charge, losses of the motor and
limits of regeneration from the BMW i3, heat transfer to the coolant, chiller and ageing from the paper.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from iptm_core.parameters.flat import Source, SourceTag, field_specs
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

FITTED_CAR = "bmw_i3"
CARS_FILE = Path(__file__).parent / "sets" / "cars.csv"
_CELLS_FILE = CARS_FILE.with_name("cells.csv")
_KG_PER_POUND, _N_PER_POUND_FORCE, _M_S_PER_MPH = 0.45359237, 4.4482216153, 0.44704
_LOAD_M_S: FloatArray = np.linspace(1.0, 130.0 / 3.6, 131, dtype=np.float64)
"""Speeds at which a road load is met, with equal relative weights."""
_STATED, _DERIVED, _CHOSEN = SourceTag.PUBLISHED, SourceTag.DERIVED, SourceTag.CHOSEN
_I3_POWER_KW, _I3_TORQUE_NM = 125.0, 250.0
"""The maker's figures."""
INERTIA_FACTOR, AUXILIARY_POWER_W, _DRIVELINE = 1.015, 200.0, 0.93
"""As in the validation study, where one drivetrain serves the whole list."""
CHARGING_EFFICIENCY = 0.88
"""From the grid into the battery and out again, chosen."""
_EPA = "EPA list of test cars, model year 2022"


@dataclass(frozen=True)
class Car:
    """Published data of a car: a row of ``cars.csv``, in the units of the source.

    Attributes:
        turns_per_min_mph: speed of the motor over the speed of the car.
        power_kw: rated power of all motors; ``torque_nm`` is their largest torque.
        area_m2: chosen, as only its product with the drag coefficient counts.
        udds_wh_km: measured consumption from the grid; ``hwfet_wh_km`` likewise.
    """

    name: str
    car: str
    weight_lb: float
    load_lbf: float
    load_lbf_mph: float
    load_lbf_mph2: float
    turns_per_min_mph: float
    power_kw: float
    torque_nm: float
    top_km_h: float
    energy_kwh: float
    modules: int
    series: int
    parallel: int
    area_m2: float
    udds_wh_km: float
    hwfet_wh_km: float
    source: str

    @property
    def mass_kg(self) -> float:
        """Equivalent test weight."""
        return self.weight_lb * _KG_PER_POUND

    def road_load_n(self, speed_m_s: FloatArray) -> FloatArray:
        """Return the road load at speeds, shape (n,)."""
        mph = speed_m_s / _M_S_PER_MPH
        pounds = self.load_lbf + self.load_lbf_mph * mph + self.load_lbf_mph2 * mph**2
        return np.asarray(pounds * _N_PER_POUND_FORCE, dtype=np.float64)


@dataclass(frozen=True)
class Cell:
    """Published data of a cell: a row of ``cells.csv``.

    Attributes:
        celsius: temperature of ``resistance_ohm``, which changes from there as
            ``offset_share + (1 - offset_share) exp(-exponent_1_k (T - T_0))``.
        half_charge_v: open-circuit voltage at half charge.
    """

    name: str
    cell: str
    capacity_ah: float
    resistance_ohm: float
    celsius: float
    exponent_1_k: float
    offset_share: float
    heat_capacity_j_k: float
    entropic_v_k: float
    half_charge_v: float
    source: str


_Row = TypeVar("_Row", Car, Cell)


@cache
def cars() -> Mapping[str, Car]:
    """Cars of the table by name."""
    return _table(CARS_FILE, Car)


@cache
def cells() -> Mapping[str, Cell]:
    """Cells of the table by name."""
    return _table(_CELLS_FILE, Cell)


def car_entries(car: Car, i3: ModelParameters, paper: ModelParameters) -> dict[str, Source]:
    """Return the parameters of a car, by dotted key, that differ from the i3's.

    Args:
        i3: parameters of `FITTED_CAR`.
        paper: parameters of the default set.
    """
    rolling, drag = _road_load(car, i3)
    radius_m = i3.powertrain.wheel_radius_m
    turns = car.turns_per_min_mph * 2.0 * math.pi / 60.0 / _M_S_PER_MPH
    power = car.power_kw / _I3_POWER_KW
    motor = i3.powertrain
    top_m_s = car.top_km_h / 3.6
    i3_turns = motor.transmission_ratio * motor.final_drive_ratio / radius_m
    slower = i3.limits.max_speed_m_s * i3_turns / (top_m_s * turns)
    share = i3.regeneration.torque_nm * i3_turns / i3.body.mass_kg
    entries = {
        "body.mass_kg": (car.mass_kg, _STATED, f"equivalent test weight: {_EPA}"),
        "body.rolling_resistance": (rolling, _DERIVED, f"fitted to the road load: {_EPA}"),
        "body.drag_coefficient": (
            drag,
            _DERIVED,
            "fitted to the same road load, for air of 20 degC",
        ),
        "body.frontal_area_m2": (car.area_m2, _CHOSEN, "only its product with the drag counts"),
        "body.rotational_inertia_factor": (INERTIA_FACTOR, _CHOSEN, "as for the list of test cars"),
        "powertrain.transmission_ratio": (
            turns * radius_m,
            _DERIVED,
            f"speed of the motor: {_EPA}",
        ),
        "powertrain.driveline_efficiency": (
            _DRIVELINE,
            _CHOSEN,
            "with the losses of the motor 0.89",
        ),
        "powertrain.motor_loss_w_per_nm2": (
            motor.motor_loss_w_per_nm2 * power * (_I3_TORQUE_NM / car.torque_nm) ** 2,
            _DERIVED,
            "the i3's share of the rated power at the largest torque",
        ),
        "powertrain.drag_loss_w_s2_rad2": (
            motor.drag_loss_w_s2_rad2 * power * slower**2,
            _DERIVED,
            "the i3's share of the rated power at top speed",
        ),
        "regeneration.torque_nm": (share * car.mass_kg / turns, _DERIVED, "the i3's deceleration"),
        "regeneration.power_w": (
            i3.regeneration.power_w * car.mass_kg / i3.body.mass_kg,
            _DERIVED,
            "the i3's power per weight",
        ),
        "cooling.auxiliary_power_w": (AUXILIARY_POWER_W, _CHOSEN, "as for the list of test cars"),
        "limits.max_speed_m_s": (top_m_s, _STATED, car.source),
    }
    volts = _half_charge_v(i3)
    capacity_ah = 1000.0 * car.energy_kwh / (volts * car.modules * car.series) / car.parallel
    pack = pack_entries(
        _scaled(i3, capacity_ah), car.modules, car.modules * car.series, car.parallel, i3, paper
    )
    return {key: _source(key, *entry) for key, entry in entries.items()} | pack


def pack_entries(
    cell: Cell,
    modules: int,
    series: int,
    parallel: int,
    i3: ModelParameters,
    paper: ModelParameters,
) -> dict[str, Source]:
    """Return the parameters of a pack, by dotted key: layout, cell, heat transfer and ageing.

    Args:
        modules: coolant channels, each with an equal part of the cells in series.
        series: groups of cells between the terminals, a multiple of ``modules``.
        parallel: cells of a group.
    """
    count = series * parallel
    entropic_v = series * (cell.celsius + CELSIUS_ZERO_K) * cell.entropic_v_k
    energy = count * cell.capacity_ah * cell.half_charge_v
    i3_energy = i3.pack.cells * i3.cell.nominal_capacity_ah * _half_charge_v(i3)
    conductance_w_k = paper.cooling.convective_coefficient_w_k * paper.pack.cells
    throughput = (
        paper.cell.nominal_capacity_ah / cell.capacity_ah
    ) ** paper.aging.throughput_exponent
    entries = {
        "pack.modules": (modules, _STATED, "coolant channels, taken as equal"),
        "pack.series_per_module": (series // modules, _STATED, cell.source),
        "pack.parallel": (parallel, _STATED, cell.source),
        "pack.cells_per_channel": (count // modules, _DERIVED, "one channel per module"),
        "pack.open_circuit_voltage_v": (
            series * cell.half_charge_v + entropic_v,
            _DERIVED,
            "at half charge, with the entropic voltage",
        ),
        "cell.heat_capacity_j_k": (cell.heat_capacity_j_k, _STATED, cell.source),
        "cell.nominal_capacity_ah": (cell.capacity_ah, _STATED, cell.source),
        "cell.nominal_resistance_ohm": (cell.resistance_ohm, _STATED, cell.source),
        "cell.nominal_temperature_k": (cell.celsius + CELSIUS_ZERO_K, _STATED, cell.source),
        "cell.resistance_exponent_1_k": (cell.exponent_1_k, _STATED, cell.source),
        "cell.resistance_offset_share": (cell.offset_share, _STATED, cell.source),
        "cell.entropic_coefficient_v_k": (cell.entropic_v_k, _STATED, cell.source),
        "aging.pre_exponential_factor": (
            paper.aging.pre_exponential_factor * throughput,
            _DERIVED,
            "the paper's, for the same loss at the same throughput per capacity",
        ),
        "cooling.convective_coefficient_w_k": (
            conductance_w_k / count,
            _DERIVED,
            "the paper's total of its 3648 cells",
        ),
        "cooling.air_exchange_w_k": (
            i3.cooling.air_exchange_w_k * (energy / i3_energy) ** (2.0 / 3.0),
            _DERIVED,
            "the i3's, scaled with the surface",
        ),
    }
    return {key: _source(key, *entry) for key, entry in entries.items()}


def _source(key: str, value: float, tag: SourceTag, note: str) -> Source:
    return Source(value, field_specs()[key].unit, tag, note)


def _half_charge_v(model: ModelParameters) -> float:
    """Return the open-circuit voltage of a cell at half charge."""
    entropic_v = model.cell.nominal_temperature_k * model.cell.entropic_coefficient_v_k
    return model.pack.open_circuit_voltage_v / model.pack.cells_in_series - entropic_v


def _scaled(model: ModelParameters, capacity_ah: float) -> Cell:
    """Return the cell of a set, made larger or smaller."""
    cell = model.cell
    size = capacity_ah / cell.nominal_capacity_ah
    return Cell(
        "",
        "",
        capacity_ah,
        cell.nominal_resistance_ohm / size,
        cell.nominal_temperature_k - CELSIUS_ZERO_K,
        cell.resistance_exponent_1_k,
        cell.resistance_offset_share,
        cell.heat_capacity_j_k * size,
        cell.entropic_coefficient_v_k,
        _half_charge_v(model),
        "the i3's cell, scaled to the energy of the pack",
    )


def _road_load(car: Car, i3: ModelParameters) -> tuple[float, float]:
    """Return rolling resistance and drag coefficient that meet the road load of a car."""
    load_n = car.road_load_n(_LOAD_M_S)
    body = i3.body
    columns = np.stack(
        [
            np.full_like(_LOAD_M_S, car.mass_kg * body.gravity_m_s2),
            0.5 * body.air_density_kg_m3 * car.area_m2 * _LOAD_M_S**2,
        ],
        axis=1,
    )
    found = np.linalg.lstsq(columns / load_n[:, None], np.ones_like(load_n), rcond=None)[0]
    return float(found[0]), float(found[1])


def _table(path: Path, row_type: type[_Row]) -> dict[str, _Row]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    kinds = {"float": float, "int": int, "str": str}
    return {
        row["name"]: row_type(
            **{each.name: kinds[str(each.type)](row[each.name]) for each in fields(row_type)}
        )
        for row in rows
    }

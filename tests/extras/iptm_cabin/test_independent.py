"""Trips again by another program: its own equations in NumPy, integrated by SciPy, from recorded inputs."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest

import iptm
from iptm_cabin.cycle_map import MAPS
from iptm_cabin.parameters import cabin_of
from iptm_cabin.trips import drive_with_cabin

integrate = pytest.importorskip("scipy.integrate", reason="SciPy is not installed")

TOLERANCE = 1e-6
ZERO_C = 273.15


@cache
def read_maps() -> Any:
    return json.loads(MAPS.read_text("utf-8"))


def positive(value: float) -> float:
    return max(value, 0.0)


def soft(a: float, b: float, width: float) -> float:
    return float(0.5 * (a + b + np.hypot(a - b, width)))


def polynomial(coefficients: list[float], *at: float) -> float:
    x, y, z = at[0] / 30.0, (at[1] - 40.0) / 30.0, (at[2] - 80.0) / 65.0
    terms = [
        x**i * y**j * z**k for i in range(5) for j in range(5) for k in range(5) if i + j + k <= 4
    ]
    return float(np.dot(coefficients, terms))


def compressor(
    inputs: Any, states: Any, speed: float, air_c: float, p: Any
) -> tuple[float, float, float]:
    """Electric power of compressor and outside fan, and heat taken from the drive, in W."""
    cabin_w, pack_w = inputs
    cabin_c, _, core_c, drive_c, one_c, n_c = states - ZERO_C
    pack_c = 0.5 * (one_c + n_c)
    heat, cold = positive(cabin_w) + positive(pack_w), positive(-pack_w)
    dry = positive(-cabin_w)

    def water(c: float) -> float:
        return float(0.622 * 6.112 * np.exp(17.62 * c / (243.12 + c)) / 1013.25)

    wet = soft(p.humidity * water(air_c) - water(8.0), 0.0, 1e-4)
    coil_w = dry + p.fresh_share * p.blown_air_kg_s * 2.45e6 * wet * dry / (dry + 200.0)
    cold += coil_w
    outside = p.outside_w_k + p.outside_j_k_m * speed
    needed = positive(0.65 * heat - cold)
    offered = p.waste_w_k * soft(drive_c - air_c, 0.0, 1.0) * heat / (heat + 200.0)
    waste = needed * offered / (needed + offered + 80.0)
    absorbed, rejected = needed - waste, positive(1.33 * cold - heat)
    mixed = p.fresh_share * air_c + (1.0 - p.fresh_share) * cabin_c

    def aside(load: float) -> float:
        return 60.0 * 6400.0 / (load * load + 6400.0)

    low = [
        mixed - 3.0 - coil_w / p.evaporator_w_k + aside(coil_w),
        pack_c - 3.0 - positive(-pack_w) / p.chiller_w_k + aside(positive(-pack_w)),
        air_c - 3.0 - absorbed / outside + aside(absorbed),
    ]
    high = [
        core_c + 3.0 + positive(cabin_w) / p.condenser_w_k - aside(positive(cabin_w)),
        pack_c + 3.0 + positive(pack_w) / p.chiller_w_k - aside(positive(pack_w)),
        air_c + 3.0 + rejected / outside - aside(rejected),
    ]
    te = -soft(soft(-low[0], -low[1], 1.0), -low[2], 1.0)
    tc = soft(soft(high[0], high[1], 1.0), high[2], 1.0)
    te = -soft(-soft(te, -30.0, 1.0), -20.0, 1.0)
    tc = -soft(-soft(soft(tc, te + 10.0, 1.0), 20.0, 1.0), -70.0, 1.0)

    def rounds(hz: float) -> float:
        return -soft(-soft(hz, 15.0, 2.0), -145.0, 2.0)

    maps = read_maps()[str(p.refrigerant)]
    full = np.exp(polynomial(maps["capacity"], te, tc, rounds(p.max_speed_hz)))
    share = max(cold, 0.65 * heat) / (full * p.displacement_cm3 * 1e-6 * p.max_speed_hz)
    hz = rounds(p.max_speed_hz * share)
    cop = (te + ZERO_C) / (tc - te) * np.exp(polynomial(maps["cop"], te, tc, hz))
    moved = absorbed + rejected
    fan = p.outside_fan_w * np.exp(-speed / 8.0) * moved / (moved + 3000.0)
    return max(cold / cop, heat / (cop + 0.95)), float(fan), waste


@cache
def behind(passed: int, cells: int, share: float) -> tuple[float, float, float]:
    """Weights of inlet, first and last cell in the coolant behind some cells, for evenly spread ones."""
    order = np.arange(passed)
    parts = share * (1.0 - share) ** (passed - 1 - order)
    last = float((parts * order / (cells - 1)).sum())
    return float((1.0 - share) ** passed), float(parts.sum()) - last, last


def slopes(
    states: Any, inputs: Any, speed: float, heat: float, waste: float, air: float, p: Any, car: Any
) -> Any:
    """Rates of air, interior, core, drive and both cells in K/s; inputs have the waste taken at the end."""
    cabin_w, pack_w, ptc_w, valve, taken_waste = inputs
    a, i, h, d, one, n = states
    mixed = p.fresh_share * air + (1.0 - p.fresh_share) * a
    core = p.core_conductance_w_k * (h - mixed)
    shell = p.shell_conductance_w_k + p.shell_conductance_j_k_m * speed
    shell += 1006.0 * p.fresh_share * p.blown_air_kg_s + p.open_windows_w_k
    sun = p.sun_aperture_m2 * p.sun_w_m2
    within = p.interior_conductance_w_k * (i - a)
    to_air = within + shell * (air - a) + core - positive(-cabin_w)
    to_air += 100.0 * p.occupants + p.blower_power_w + p.sun_share_of_air * sun
    board = p.interior_outside_w_k * (air - i) - within + (1.0 - p.sun_share_of_air) * sun
    wind = (0.3 + speed / 20.0) ** 0.6
    cooling, pack, cell = car.cooling, car.pack, car.cell
    flow = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k
    share = cooling.convective_coefficient_w_k * pack.modules / flow
    cells = pack.cells_per_channel

    w_in, w_one, w_n = behind(cells, cells, share)
    # Outlet, inlet and radiator at once: three linear equations.
    conductance = p.radiator_w_k * wind * valve
    matrix = [[1.0, -w_in, 0.0], [-1.0, 1.0, 1.0 / flow], [-conductance, 0.0, 1.0]]
    right = [w_one * one + w_n * n, pack_w / flow, -conductance * air]
    _, t_in, radiator = np.linalg.solve(matrix, right)
    taken = radiator - pack_w
    l_in, l_one, l_n = behind(cells - 1, cells, share)
    at_n = l_in * t_in + l_one * one + l_n * n
    exchange = cooling.air_exchange_w_k
    rate = cooling.convective_coefficient_w_k / cell.heat_capacity_j_k
    outside = [exchange / pack.cells * (air - each) for each in (one, n)]
    whole = pack.cells * cell.heat_capacity_j_k
    mean = (heat - taken + 0.5 * pack.cells * sum(outside)) / whole
    apart = 0.5 * (
        (outside[1] - outside[0]) / cell.heat_capacity_j_k + rate * (at_n - n - t_in + one)
    )
    return [
        to_air / p.air_heat_capacity_j_k,
        board / p.interior_heat_capacity_j_k,
        (positive(cabin_w) + ptc_w - core) / p.core_heat_capacity_j_k,
        (waste - taken_waste - p.drive_radiator_w_k * wind * (d - air)) / p.drive_heat_capacity_j_k,
        mean - apart,
        mean + apart,
    ]


@pytest.mark.parametrize(
    ("cycle", "air_c", "control"),
    [("udds", 35.0, "published"), ("wltc_class3b", -10.0, "rule"), ("hwfet", 5.0, "published")],
)
def test_another_program_finds_the_same_trip(cycle: str, air_c: float, control: str) -> None:
    """Temperatures to 1e-6 K, and the power of the compressor to 1e-6 of it, in every interval."""
    changes = {"control": control, "sun_w_m2": 700.0 if air_c > 30.0 else 0.0}
    settings: dict[str, Any] = {"strategy": "production", "climate": air_c, "duration_s": 30.0}
    run, table = drive_with_cabin(cycle, "mid_size.cabin", changes, vehicle="bmw_i3", **settings)
    p = cabin_of(changes)  # mid_size has the defaults
    off_k, off_w = worst_difference(run, table, p)
    assert off_k <= TOLERANCE
    assert off_w <= TOLERANCE


def worst_difference(run: iptm.Run, table: pd.DataFrame, p: Any) -> tuple[float, float]:
    car, frame = run.parameters, run.frame
    air = car.environment.ambient_temperature_k
    nodes = table[["air_k", "interior_k", "core_k", "drive_k"]].to_numpy()
    cells = frame[["cell_1_temperature_k", "cell_n_temperature_k"]].to_numpy()
    given = table[["cabin_w", "pack_w", "ptc_w", "radiator", "compressor_w"]].to_numpy()
    speed = frame.speed_m_s.to_numpy()
    heat, traction = frame.battery_heat_w.to_numpy(), frame.traction_power_w.to_numpy()
    states = np.r_[nodes[0], cells[0]]
    off_k = off_w = 0.0
    for k in range(1, len(table)):
        cabin_w, pack_w, ptc_w, valve, power = given[k]
        own, _, waste = compressor((cabin_w, pack_w), states, speed[k - 1], air - ZERO_C, p)
        off_w = max(off_w, abs(own - power) / max(power, 1.0))
        held = (cabin_w, pack_w, ptc_w, valve, waste)
        mean, made = 0.5 * (speed[k - 1] + speed[k]), p.drive_waste_share * abs(traction[k])

        def rates(
            _: float, now: Any, held: Any = held, mean: float = mean, made: float = made, k: int = k
        ) -> Any:
            return slopes(now, held, mean, heat[k], made, air, p, car)

        found = integrate.solve_ivp(rates, (0.0, 1.0), states, rtol=1e-9, atol=1e-9, method="RK45")
        states = found.y[:, -1]
        off_k = max(off_k, float(np.abs(states - np.r_[nodes[k], cells[k]]).max()))
    return off_k, off_w

"""Fit the maps of the refrigerant cycle: `python -m iptm_cabin.cycle_fit` writes ``cycle_maps.json``.

The only module that needs CoolProp (requirements/cabin.txt). A single-stage cycle with 5 K of superheat and,
for subcritical refrigerants, 5 K of subcooling; of R744 the temperature of the gas cooler's outlet takes the
place of the one of condensation, and the high pressure above the critical point is the optimal one of Liao,
Zhao and Jakobsen (Applied Thermal Engineering 20, 2000, pp. 831-841). Efficiencies of the compressor over
pressure ratio and speed are chosen, at the level of published electric scroll compressors.
"""

from __future__ import annotations

import json
import math
from importlib import import_module
from typing import Any

import numpy as np

from iptm_cabin.cycle_map import BOUNDS, LEAST_LIFT_K, MAPS, Refrigerant, basis
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K

SUPERHEAT_K, SUBCOOLING_K = 5.0, 5.0
GAS_COOLER_APPROACH_K = 3.0
MOTOR_EFFICIENCY = 0.90
FITTED, HELD_OUT = 2000, 1000
_SMOOTHING_PA = 4e5


def properties(*arguments: Any) -> float:
    """Return a property of a fluid, see CoolProp's PropsSI."""
    return float(import_module("CoolProp.CoolProp").PropsSI(*arguments))


def cycle(
    fluid: Refrigerant, evaporation_c: float, condensation_c: float, speed_hz: float
) -> tuple[float, float]:
    """Return the coefficient of performance of cooling and the capacity in J per m^3 of displacement."""
    name = fluid.value
    low_k, high_k = evaporation_c + CELSIUS_ZERO_K, condensation_c + CELSIUS_ZERO_K
    low_pa = properties("P", "T", low_k, "Q", 1, name)
    suction_k = low_k + SUPERHEAT_K
    enthalpy, entropy, density = (
        properties(each, "T", suction_k, "P", low_pa, name) for each in "HSD"
    )
    if fluid is Refrigerant.R744:
        high_pa = _high_pressure_pa(evaporation_c, condensation_c)
        liquid = properties("H", "T", high_k, "P", high_pa, name)
    else:
        high_pa = properties("P", "T", high_k, "Q", 0, name)
        liquid = properties("H", "T", high_k - SUBCOOLING_K, "P", high_pa, name)
    isentropic, volumetric = efficiencies(high_pa / low_pa, speed_hz)
    work = (properties("H", "S", entropy, "P", high_pa, name) - enthalpy) / (
        isentropic * MOTOR_EFFICIENCY
    )
    return (enthalpy - liquid) / work, (enthalpy - liquid) * density * volumetric


def _high_pressure_pa(evaporation_c: float, outlet_c: float) -> float:
    """Return the high pressure of R744: condensing below the critical point, the optimal one above it."""
    critical_c = 30.9
    condensing_c = min(outlet_c + GAS_COOLER_APPROACH_K, critical_c)
    condensing = properties("P", "T", condensing_c + CELSIUS_ZERO_K, "Q", 0, "R744")
    optimal = 1e5 * ((2.778 - 0.0157 * evaporation_c) * outlet_c + 0.381 * evaporation_c - 9.34)
    apart = optimal - condensing
    return 0.5 * (optimal + condensing + float(np.hypot(apart, _SMOOTHING_PA)))


def efficiencies(pressure_ratio: float, speed_hz: float) -> tuple[float, float]:
    """Return the isentropic and the volumetric efficiency of the compressor."""
    away = math.log(pressure_ratio / 2.8)
    fast = speed_hz / 100.0
    isentropic = (0.72 - 0.06 * away**2) * (1.0 - 0.12 * (fast - 0.6) ** 2)
    volumetric = 0.96 * math.exp(-0.024 * (pressure_ratio - 1.0)) * (1.0 - 0.02 / fast)
    return isentropic, volumetric


def samples(fluid: Refrigerant, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return random operating points, shape (n, 3), and COP and capacity at each, shape (n, 2)."""
    random = np.random.default_rng(seed)
    low, high = np.array(BOUNDS[fluid]).T
    points: list[FloatArray] = []
    while len(points) < count:
        point = random.uniform(low, high)
        if point[1] - point[0] >= LEAST_LIFT_K:
            points.append(point)
    found = [cycle(fluid, *(float(each) for each in point)) for point in points]
    return np.array(points), np.array(found)


def fit(fluid: Refrigerant) -> dict[str, Any]:
    """Return the coefficients of a refrigerant, and their errors at points that were held out."""
    points, values = samples(fluid, FITTED, 1)
    carnot = (points[:, 0] + CELSIUS_ZERO_K) / (points[:, 1] - points[:, 0])
    rows = np.array(basis(*points.T)).T
    targets = np.log(np.c_[values[:, 0] / carnot, values[:, 1]])
    coefficients, *_ = np.linalg.lstsq(rows, targets, rcond=None)
    held, true = samples(fluid, HELD_OUT, 2)
    carnot = (held[:, 0] + CELSIUS_ZERO_K) / (held[:, 1] - held[:, 0])
    guess = np.exp(np.array(basis(*held.T)).T @ coefficients)
    guess[:, 0] *= carnot
    error = guess / true - 1.0
    return {
        "cop": coefficients[:, 0].tolist(),
        "capacity": coefficients[:, 1].tolist(),
        "rms": np.sqrt((error**2).mean(0)).round(5).tolist(),
        "worst": np.abs(error).max(0).round(5).tolist(),
    }


def main() -> None:
    """Fit all refrigerants and write the maps."""
    maps = {fluid.value: fit(fluid) for fluid in Refrigerant}
    MAPS.write_text(json.dumps(maps, indent=1) + "\n", "utf-8")
    for name, found in maps.items():
        print(name, "rms", found["rms"], "worst", found["worst"])


if __name__ == "__main__":
    main()

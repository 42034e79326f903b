"""The cabin beside a second program: FASTSim 3's Bolt on the same roads and days (``fastsim.json``)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from studies.savings import PRODUCTION

from iptm_cabin.trips import drive_with_cabin
from iptm_core.units import CELSIUS_ZERO_K

FOUND = Path(__file__).with_name("fastsim.json")
CAR, CABIN = "chevrolet_bolt", "chevrolet_bolt.cabin"
ALIKE = {"control": "alone", "occupants": 0.0, "blower_power_w": 0.0, "humidity": 0.0}
"""FASTSim has neither persons nor blower nor water in the air."""
BODY = {
    "body.mass_kg": 1626.129,
    "body.rolling_resistance": 0.007767205,
    "body.drag_coefficient": 0.309,
    "body.frontal_area_m2": 2.396898,
    "cooling.auxiliary_power_w": 250.0,
}
"""Of FASTSim's car, a Bolt EV of 2020; the suite's is an EUV of 2022."""
CASES, EVERY_S = 5, 30
J_KWH = 3.6e6


def cases() -> list[dict[str, Any]]:
    """Return what FASTSim found, by case."""
    found: list[dict[str, Any]] = json.loads(FOUND.read_text("utf-8"))
    return found


def compared(number: int, duration_s: float | None = None) -> dict[str, Any]:
    """Return a case by both programs: heat into the cabin, electricity for it, and temperatures."""
    case = cases()[number]
    length = {} if duration_s is None else {"duration_s": duration_s}
    run, table = drive_with_cabin(
        case["cycle"],
        CABIN,
        {**ALIKE, "initial_c": case["start_c"]},
        vehicle=CAR,
        strategy=PRODUCTION,
        climate=case["air_c"],
        overrides=BODY,
        **length,
    )
    step_s = float(table.index[1] - table.index[0])
    heat_kwh = float((table.cabin_w + table.ptc_w).sum()) * step_s / J_KWH
    electric_kwh = float(table.electric_w.sum()) * step_s / J_KWH
    own_c = np.interp(
        np.arange(len(case["cabin_c"])) * EVERY_S, table.index, table.air_k - CELSIUS_ZERO_K
    )
    cells_kwh = float(run.figures["cell_energy"]) / 3600.0
    return {
        "cycle": case["cycle"],
        "air_c": case["air_c"],
        "start_c": case["start_c"],
        "heat_kwh": heat_kwh,
        "other_heat_kwh": case["heat_kwh"],
        "heat": 100.0 * (heat_kwh / case["heat_kwh"] - 1.0),
        "electric_kwh": electric_kwh,
        "other_electric_kwh": case["electric_kwh"],
        "electric": 100.0 * (electric_kwh / case["electric_kwh"] - 1.0),
        "apart_k": float(np.sqrt(np.mean((own_c - np.array(case["cabin_c"])) ** 2))),
        "pack_kwh": cells_kwh,
        "other_pack_kwh": case["pack_kwh"],
        "pack": 100.0 * (cells_kwh / case["pack_kwh"] - 1.0),
    }

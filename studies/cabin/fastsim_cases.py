"""Drive the cases of `second_program` by FASTSim 3 (NREL), and write what it finds: ``fastsim.json``.

    pip install fastsim==3.1.0 in an environment of its own, then: python studies/cabin/fastsim_cases.py

Needs nothing else of this repository. The car is FASTSim's "2020 Chevrolet Bolt EV thrml" with its cabin; the
pack is left alone.
"""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

CAR = "2020 Chevrolet Bolt EV thrml.yaml"
CASES = (
    ("udds", -7.0, -7.0),
    ("hwfet", -7.0, -7.0),
    ("udds", 0.0, 0.0),
    ("udds", 35.0, 50.0),
    ("hwfet", 35.0, 50.0),
)
"""Cycle, air in degC, cabin at the start in degC."""
EVERY_S = 30
_ZERO_C = 273.15
_CABIN = "veh.cabin.LumpedCabin.history."
_HVAC = "veh.hvac.LumpedCabinAndRES.history."
_PACK = "veh.pt_type.BEV.res.history."


def drive(cycle: str, air_c: float, cabin_c: float) -> dict[str, Any]:
    """Return heat into the cabin, electricity for it and of the pack in kWh, and the cabin's temperatures."""
    fastsim = import_module("fastsim")
    car = fastsim.Vehicle.from_resource(CAR).to_dict()
    pack = car["pt_type"]["BEV"]["res"]
    pack["state"]["soc"] = 0.8
    for state, degrees in (
        (pack["thrml"]["RESLumpedThermal"]["state"], air_c),
        (car["cabin"]["LumpedCabin"]["state"], cabin_c),
    ):
        state["temperature_kelvin"] = state["temp_prev_kelvin"] = degrees + _ZERO_C
    car["hvac"]["LumpedCabinAndRES"]["te_deadband_res_kelvin"] = 300.0
    road = fastsim.Cycle.from_resource(f"{cycle}.csv").to_dict()
    road["temp_amb_air_kelvin"] = [air_c + _ZERO_C] * len(road["time_seconds"])
    trip = fastsim.SimDrive(fastsim.Vehicle.from_dict(car), fastsim.Cycle.from_dict(road))
    trip.walk()
    table = trip.to_dataframe()

    def last_kwh(name: str) -> float:
        return round(float(table[name].iloc[-1]) / 3.6e6, 4)

    degrees = table[f"{_CABIN}temperature_kelvin"].to_numpy()[::EVERY_S] - _ZERO_C
    return {
        "cycle": cycle,
        "air_c": air_c,
        "start_c": cabin_c,
        "heat_kwh": last_kwh(f"{_CABIN}energy_thrml_from_hvac_joules"),
        "electric_kwh": last_kwh(f"{_HVAC}energy_aux_for_cab_hvac_joules"),
        "pack_kwh": last_kwh(f"{_PACK}energy_out_chemical_joules"),
        "distance_m": round(float(table["veh.history.dist_meters"].iloc[-1]), 1),
        "cabin_c": [round(float(each), 3) for each in degrees],
    }


if __name__ == "__main__":
    found = [drive(*case) for case in CASES]
    path = Path(__file__).parent / "fastsim.json"
    path.write_text(json.dumps(found) + "\n", encoding="utf-8")

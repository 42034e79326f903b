"""Climate controls: what they keep, what broken parts and bad files do, and the predictive one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iptm
from iptm_cabin.cabin_plant import CabinVehicleState, plant_with
from iptm_cabin.climate_control import BOTH, ClimateUnit
from iptm_cabin.parameters import (
    CabinParameters,
    ClimateControl,
    air_course,
    cabin_of,
    read_cabin,
)
from iptm_cabin.thermal_functions import thermal_functions
from iptm_cabin.trips import comfort, drive_with_cabin
from iptm_core.errors import IptmError
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, VehicleState
from iptm_plant_sim.plant import Plant


def driven(cabin: CabinParameters, ticks: int, air_c: float = 0.0) -> tuple[VehicleState, Plant]:
    """A standing car after some ticks."""
    changes = {"environment.ambient_temperature_k": air_c + 273.15}
    changes["environment.initial_cell_temperature_k"] = max(air_c, -20.0) + 273.15
    car = load_parameters("bmw_i3", overrides=changes).values
    plant = plant_with(cabin)(car, np.zeros_like)
    state: VehicleState = plant.initial_state()
    for _ in range(ticks):
        state = plant.advance(state, Command(0.0, 0.0)).state
    return state, plant


def cabin_c(state: VehicleState) -> float:
    assert isinstance(state, CabinVehicleState)
    return state.cabin.air_k - 273.15


@pytest.mark.parametrize(("air_c", "start_c"), [(0.0, 0.0), (35.0, 50.0)])
def test_the_thermostat_keeps_the_set_point(air_c: float, start_c: float) -> None:
    state, _ = driven(CabinParameters(initial_c=start_c, set_point_c=21.0), 900, air_c)
    assert cabin_c(state) == pytest.approx(21.0, abs=0.7)


BAD_DAYS: dict[str, tuple[dict[str, Any], float, str]] = {
    "compressor dead": ({"broken": "compressor"}, -5.0, "compressor is broken"),
    "heater dead": ({"broken": "ptc"}, -5.0, "ptc is broken"),
    "fan dead": ({"broken": "fan"}, -5.0, "fan is broken"),
    "sensor lost (NaN)": ({"broken": "sensor_lost"}, -5.0, "sensor is lost"),
    "sensor frozen": ({"broken": "sensor_frozen"}, -5.0, "repeats a reading"),
    "soaked": ({"initial_c": 70.0, "sun_w_m2": 1000.0}, 50.0, "highest pressure limits"),
    "coldest": ({}, -30.0, "frost on the outside heat exchanger limits"),
    "windows open": ({"open_windows_w_k": 1000.0}, -5.0, "compressor's speed limits"),
    "map left": ({"control": "command", "initial_c": 22.0}, 22.0, "leaves the map"),
    "pack without heat pump": ({"is_heat_pump": False}, -10.0, "no heat pump"),
}
"""Bad days: changes of the cabin's file, the air in degC, and the report."""
CELLS_C = {"map left": 40.0, "coldest": -20.0}
"""Cells that begin at another temperature than the air: a hot pack is cooled for itself."""


@pytest.mark.parametrize("name", BAD_DAYS)
def test_a_bad_day_is_named_and_the_trip_goes_on(name: str) -> None:
    changes, air_c, named = BAD_DAYS[name]
    seconds = 75.0 if "frozen" in name else 20.0
    car: dict[str, Any] = {}
    if name in CELLS_C:
        car = {"overrides": {"environment.initial_cell_temperature_k": 273.15 + CELLS_C[name]}}
    run, table = drive_with_cabin(
        "us06",
        "mid_size.cabin",
        changes,
        duration_s=seconds,
        climate=air_c,
        strategy="production",
        **car,
    )
    assert len(table) == seconds + 1
    assert any(named in note for note in run.warnings), run.warnings
    assert np.isfinite(table.to_numpy()).all()
    assert (table.electric_w < 12e3).all()
    if "heater" in name:
        assert table.ptc_w.max() == 0.0
    if "compressor dead" in name:
        assert table.compressor_w.max() == 0.0


def test_heater_and_cooling_together_are_refused_by_name() -> None:
    cabin = CabinParameters()
    functions = thermal_functions(cabin, load_parameters("paper_calibrated").values)
    states = (308.0, 308.0, 308.0, 308.0, 305.0, 305.0)
    weather = (10.0, 0.0, 0.0, 308.0, 0.0)
    (cabin_w, _, ptc_w, _), report = ClimateUnit(functions).within(
        states, weather, -500.0, 0.0, 0.0, ptc_w=1000.0, by_loop_w=-1500.0
    )
    assert cabin_w == -1500.0
    assert ptc_w == 0.0
    assert report == BOTH


def test_cells_follow_air_that_warms_as_by_hand() -> None:
    """A standing car in a chamber that warms by a ramp: a lag of first order, in closed form."""
    air = {"air_over_time": "0: -20, 4500: 25"}
    quiet = {
        "control": "alone",
        "broken": "compressor",
        "max_ptc_power_w": 0.0,
        "blower_power_w": 0.0,
    }
    cabin = cabin_of({**air, **quiet})
    car = load_parameters(
        "bmw_i3",
        overrides={
            "environment.initial_cell_temperature_k": 253.15,
            "cooling.air_exchange_w_k": 400.0,
            "environment.ambient_temperature_k": 253.15,
            "cooling.auxiliary_power_w": 0.0,
        },
    ).values
    plant = plant_with(cabin)(car, np.zeros_like)
    state: VehicleState = plant.initial_state()
    seconds = 1500
    for _ in range(seconds):
        state = plant.advance(state, Command(0.0, 0.0)).state
    lag_s = car.pack.cells * car.cell.heat_capacity_j_k / car.cooling.air_exchange_w_k
    rise_k_s = 45.0 / 4500.0
    by_hand_k = 253.15 + rise_k_s * (seconds - lag_s * (1.0 - np.exp(-seconds / lag_s)))
    mean_k = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
    assert by_hand_k - 253.15 > 5.0
    assert mean_k == pytest.approx(by_hand_k, abs=0.05)


@pytest.mark.parametrize("text", ["0: -20, 0: 5", "0: warm", "0: 200", "5"])
def test_bad_air_over_time_is_refused(text: str) -> None:
    with pytest.raises(IptmError, match="air_over_time is"):
        air_course(cabin_of({"air_over_time": text}))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("set_point_c: 40", "set_point_c is 40"),
        ("setpoint_c: 21", "set_point_c"),
        ("refrigerant: R12", "R134a"),
        ("- 1", "names with values"),
        ("base: nowhere", "mid_size.cabin"),
    ],
)
def test_a_bad_file_is_refused_with_what_is_allowed(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "bad.cabin"
    path.write_text(text, "utf-8")
    with pytest.raises(IptmError, match=named):
        iptm.simulate("nycc", duration_s=5.0, plant=str(path))


def test_a_base_gives_the_other_values(tmp_path: Path) -> None:
    path = tmp_path / "mine.cabin"
    path.write_text("base: bmw_i3\nset_point_c: 20", "utf-8")
    found = read_cabin(str(path))
    assert found.set_point_c == 20.0
    assert not found.is_heat_pump


def test_all_cells_of_a_channel_are_refused() -> None:
    with pytest.raises(IptmError, match="full_channel"):
        iptm.simulate("nycc", duration_s=5.0, plant="mid_size.cabin", thermal_model="full_channel")


def test_a_command_cools_the_pack_by_the_heat_of_the_map() -> None:
    """The pack gives off what the suite's map takes at that power, while the loop has the capacity."""
    cabin = CabinParameters(control=ClimateControl.COMMAND, initial_c=22.0)
    car = load_parameters("paper_calibrated").values
    plant, own = plant_with(cabin)(car, np.zeros_like), Plant(car, np.zeros_like)
    warm: VehicleState = plant.initial_state()
    ours: VehicleState = own.initial_state()
    for _ in range(3):
        with_cabin = plant.advance(warm, Command(0.0, 400.0))
        without = own.advance(ours, Command(0.0, 400.0))
        taken_w, by_map_w = with_cabin.powers.chiller_heat_w, without.powers.chiller_heat_w
        warm, ours = with_cabin.state, without.state
    assert by_map_w > 100.0
    assert taken_w == pytest.approx(by_map_w, rel=0.02)


def test_the_predictive_control_keeps_the_cabin_and_spares_the_pack() -> None:
    changes = {"sun_w_m2": 700.0, "warm_up_price_w_k2": 12.0, "way_ahead": "us06"}
    found = {}
    for control in ("rule", "predictive"):
        run, table = drive_with_cabin(
            "us06",
            "mid_size.cabin",
            {**changes, "control": control},
            duration_s=60.0,
            climate=35.0,
            strategy="production",
        )
        assert not [note for note in run.warnings if "no plan" in note]
        found[control] = comfort(table, 22.0)["rms_k"], table
    assert found["predictive"][0] < found["rule"][0] + 1.0
    assert (found["predictive"][1].pack_w <= 1e-6).all()

"""Climate controls: what they keep, what broken parts and bad files do, and the predictive one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm_cabin.cabin_plant import CabinVehicleState, plant_with
from iptm_cabin.parameters import CabinParameters, ClimateControl, read_cabin
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


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        ("compressor", "compressor is broken"),
        ("ptc", "ptc is broken"),
        ("fan", "fan is broken"),
        ("sensor_lost", "sensor is lost"),
        ("sensor_frozen", "repeats a reading"),
    ],
)
def test_a_broken_part_is_named_and_the_trip_goes_on(broken: str, named: str) -> None:
    seconds = 75.0 if "frozen" in broken else 20.0
    run, table = drive_with_cabin(
        "us06",
        "mid_size.cabin",
        {"broken": broken},
        duration_s=seconds,
        climate=-5.0,
        strategy="production",
    )
    assert len(table) == seconds + 1
    assert any(named in note for note in run.warnings)
    assert np.isfinite(table.to_numpy()).all()
    if broken == "ptc":
        assert table.ptc_w.max() == 0.0
    if broken == "compressor":
        assert table.compressor_w.max() == 0.0


@pytest.mark.parametrize(
    ("air_c", "start_c", "windows"), [(50.0, 70.0, 0.0), (-30.0, -30.0, 0.0), (35.0, 40.0, 500.0)]
)
def test_extreme_days_are_driven(air_c: float, start_c: float, windows: float) -> None:
    cabin = CabinParameters(initial_c=start_c, open_windows_w_k=windows, sun_w_m2=200.0)
    state, _ = driven(cabin, 120, air_c)
    assert isinstance(state, CabinVehicleState)
    assert abs(cabin_c(state) - 22.0) < abs(start_c - 22.0)
    assert 0.0 <= state.cabin.electric_w < 12e3


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

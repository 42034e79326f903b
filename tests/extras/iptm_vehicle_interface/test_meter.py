"""The meter of drives that somebody else drives: by hand, against the plant, from files, and of a topic."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.user_trip import UserTrip
from iptm_core.state import Command
from iptm_plant_sim.plant import Plant
from iptm_vehicle_interface.drive_meter import DriveMeter
from iptm_vehicle_interface.meter import main, metered

PARAMETERS = load_parameters("bmw_i3").values


def test_a_steady_drive_by_hand() -> None:
    """Ten minutes at 20 m/s: road load by eq. (2), losses of motor and driveline by eqs. (3) and (5)."""
    meter = DriveMeter(PARAMETERS)
    for tick in range(601):
        meter.take(float(tick), 20.0, 500.0)
    body, powertrain = PARAMETERS.body, PARAMETERS.powertrain
    rolling = body.mass_kg * body.gravity_m_s2 * body.rolling_resistance
    drag = 0.5 * body.air_density_kg_m3 * body.drag_coefficient * body.frontal_area_m2 * 20.0**2
    ratio = powertrain.transmission_ratio * powertrain.final_drive_ratio / powertrain.wheel_radius_m
    torque = (rolling + drag) / ratio / powertrain.driveline_efficiency
    turning = 20.0 * ratio
    motor = torque * turning + powertrain.motor_loss_w_per_nm2 * torque**2
    motor += powertrain.drag_loss_w_s2_rad2 * turning**2
    reading = meter.reading
    assert reading.state.position_m == pytest.approx(12000.0)
    assert reading.traction_energy_j == pytest.approx(600.0 * motor, rel=1e-6)
    expected = 600.0 * (motor + 500.0) + reading.cooling_energy_j
    assert reading.battery_energy_j == pytest.approx(expected, rel=1e-6)
    assert reading.recovered_energy_j == 0.0
    assert reading.capacity_loss > 0.0


def test_the_meter_of_the_speeds_of_the_plant_has_the_energy_of_the_plant() -> None:
    """US06 driven by the plant with its thermostat as it is metered; 50 Hz and noise change little."""
    cycle = build_route("us06", initial_gap_m=15.0, duration_s=300.0).leader
    times = np.arange(0.0, 300.5)
    speeds = np.asarray(cycle.speeds_at(times))
    plant = Plant(PARAMETERS, lambda positions: 0.0 * positions)
    state, energy_j = plant.initial_state(), 0.0
    meter = DriveMeter(PARAMETERS)
    meter.take(0.0, 0.0)
    for time_s, wanted in zip(times[1:], speeds[1:], strict=True):
        compressor_w = meter.reading.state.compressor_power_w
        step = plant.advance(state, Command(wanted - state.speed_m_s, compressor_w), 1.0)
        state, energy_j = step.state, energy_j + step.powers.battery_power_w
        meter.take(float(time_s), state.speed_m_s)
    assert meter.reading.battery_energy_j == pytest.approx(energy_j, rel=0.01)
    assert meter.reading.state.cell_n_temperature_k == pytest.approx(
        state.cell_n_temperature_k, abs=0.2
    )
    fine = DriveMeter(PARAMETERS)
    random = np.random.default_rng(0)
    for time_s in np.arange(0.0, 300.001, 0.02):
        fine.take(float(time_s), float(np.interp(time_s, times, speeds) + random.normal(0.0, 0.02)))
    assert fine.reading.battery_energy_j == pytest.approx(energy_j, rel=0.05)


def test_a_gap_is_left_out_and_said() -> None:
    meter = DriveMeter(PARAMETERS)
    for time_s in (0.0, 1.0, 2.0, 60.0, 61.0):
        meter.take(time_s, 10.0)
    assert meter.reading.driven_s == pytest.approx(3.0)
    assert meter.reading.left_out_s == pytest.approx(58.0)
    assert meter.reading.state.position_m == pytest.approx(30.0)


def test_a_speed_that_is_not_finite_counts_as_not_measured() -> None:
    meters = DriveMeter(PARAMETERS), DriveMeter(PARAMETERS)
    for tick in range(11):
        for meter in meters:
            meter.take(float(tick), 10.0)
        meters[1].take(tick + 0.5, math.nan)
        meters[1].take(math.inf, 10.0)
    assert meters[0].reading == meters[1].reading


def test_the_suite_behind_a_drive_begins_with_the_same_pack(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "steady.csv"
    path.write_text("time_s,speed_m_s\n" + "".join(f"{t},20.0\n" for t in range(31)), "utf-8")
    arguments = [str(path), "--json", "--cell-temperature-c", "20", "--follow", "aging"]
    assert main(arguments) == 0
    driven, behind = json.loads(capsys.readouterr().out).values()
    assert driven["cell_1_temperature_c"] == pytest.approx(20.0, abs=1.0)
    assert behind["cell_1_temperature_c"] == pytest.approx(20.0, abs=1.0)
    assert main([*arguments, "--consumers-w", "500"]) == 2


def test_a_drive_that_begins_at_speed_has_no_launch_in_its_energy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "steady.csv"
    path.write_text("time_s,speed_m_s\n" + "".join(f"{t},20.0\n" for t in range(121)), "utf-8")
    assert main([str(path), "--parameter-set", "bmw_i3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["steady.csv"]
    meter = DriveMeter(PARAMETERS)
    for tick in range(121):
        meter.take(float(tick), 20.0)
    assert found["duration_s"] == pytest.approx(120.0)
    assert found["battery_energy_kwh"] == pytest.approx(
        meter.reading.battery_energy_j / 3.6e6, rel=1e-6
    )


def test_a_hill_behind_the_launch_is_where_it_is_on_the_road() -> None:
    """The launch of 10 s takes 100 m; the hill begins at 700 m."""
    speeds = np.concatenate([np.linspace(0.0, 20.0, 11), np.full(60, 20.0)])
    cycle = DrivingCycle("hill", np.arange(71.0), speeds, "made up")
    hill = SlopeProfile(np.array([0.0, 699.0, 701.0, 5000.0]), np.array([0.0, 0.0, 0.05, 0.05]))
    meter = DriveMeter(
        PARAMETERS, lambda driven_m: float(np.interp(driven_m, (599, 601), (0, 0.05)))
    )
    for tick in range(61):
        meter.take(10.0 + tick, 20.0)
    found = metered(UserTrip(cycle, hill, launch_s=10.0), PARAMETERS)
    assert found.battery_energy_j == pytest.approx(meter.reading.battery_energy_j, rel=1e-6)


@pytest.mark.parametrize(
    "arguments",
    [[], ["a.csv", "--topic", "/odom"], ["none.csv"], ["a.log", "--signal", "speed_kmh"]],
)
def test_what_cannot_be_metered_is_refused(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert "allowed" in capsys.readouterr().err
    assert not math.isnan(DriveMeter(PARAMETERS).reading.battery_energy_j)

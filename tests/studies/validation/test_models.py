"""Fits find what made-up measurements were made with; readings and bounds by hand."""

import numpy as np
import pandas as pd
import pytest
from studies.validation import epa, lead_vehicle
from studies.validation.cell import fit_pulse_law
from studies.validation.circuit import (
    REFERENCE_K,
    Circuit,
    Samples,
    Structure,
    branch_current_a,
    fit_circuit,
)
from studies.validation.epa import OneDrivetrain, fit_one_drivetrain
from studies.validation.i3_drivetrain import (
    GEAR_RATIO,
    WHEEL_RADIUS_M,
    I3Drivetrain,
    consumers_w,
    fit_drivetrain,
    objection_to,
)
from studies.validation.measurements import Drive, Driver, Trip
from studies.validation.outcome import Figure

from iptm_core.physics.cell import ChargeTable, ChargeTransfer, ResistanceLaw

RANDOM = np.random.default_rng(3)


def made_trip(name: str, heating_w: float = 0.0, recorded_w: float | None = None) -> Trip:
    """Return a trip of an i3 with known losses: 0.15 W/(N m)^2, 0.002 W s^2/rad^2 and 400 W."""
    seconds = np.arange(600.0)
    speed = np.clip(12.0 + 9.0 * np.sin(seconds / 40.0), 0.0, None)
    speed[:30] = 0.0
    torque = np.where(speed > 0.0, 40.0 * np.cos(seconds / 23.0) + RANDOM.normal(0, 5, 600), 0.0)
    motor = speed * GEAR_RATIO / WHEEL_RADIUS_M
    power = motor * torque + 0.15 * torque**2 + 0.002 * motor**2 + 400.0 + heating_w
    same = np.ones(600)
    return Trip(
        name=name,
        time_s=seconds,
        speed_m_s=speed,
        elevation_m=500.0 * same,
        motor_torque_nm=torque,
        voltage_v=360.0 * same,
        current_a=power / 360.0,
        battery_temperature_k=290.0 * same,
        charge=0.8 * same,
        heating_w=(heating_w if recorded_w is None else recorded_w) * same,
        cooling_w=0.0 * same,
        ambient_k=290.0 * same,
        heat_exchanger_k=290.0 * same,
    )


def test_losses_of_a_made_up_drivetrain_are_found_and_a_third_is_held_out() -> None:
    trips = tuple(made_trip(f"A{k:02d}") for k in range(6))
    found = fit_drivetrain(trips)
    assert found.fitted_on == ("A00", "A01", "A03", "A04")
    assert found.motor_loss_w_per_nm2 == pytest.approx(0.15, rel=1e-3)
    assert found.drag_quadratic_w_s2_rad2 == pytest.approx(0.002, rel=1e-2)
    assert found.auxiliary_power_w == pytest.approx(400.0, rel=1e-2)


def test_heater_channel_is_judged_by_the_power_at_standstill() -> None:
    drivetrain = I3Drivetrain((), 0.15, 0.0, 0.002, 400.0)
    stuck = made_trip("A01", heating_w=0.0, recorded_w=5320.0)
    assert consumers_w(stuck).max() == 0.0
    assert objection_to(stuck, drivetrain) is None
    right = made_trip("B01", heating_w=3000.0)
    assert consumers_w(right).min() == 3000.0
    spikes = made_trip("A02")
    spikes.heating_w[100:103] = 5520.0
    assert consumers_w(spikes).max() == 0.0
    unrecorded = made_trip("A03", heating_w=3000.0, recorded_w=0.0)
    assert "3.0 kW" in str(objection_to(unrecorded, drivetrain))


def test_circuit_is_found_from_its_own_voltage() -> None:
    nodes = (0.0, 0.5, 1.0)

    def law(offset: float, exponential: float) -> ResistanceLaw:
        tables = ChargeTable(nodes, (offset,) * 3), ChargeTable(nodes, (exponential,) * 3)
        return ResistanceLaw(*tables, 0.05, REFERENCE_K)

    ocv = ChargeTable(nodes, (3.0, 3.6, 4.2))
    transfer = ChargeTransfer(ChargeTable((0.0, 1.0), (0.0, 0.0)), 1.0, 0.0, REFERENCE_K)
    truth = Circuit(ocv, law(0.02, 0.01), (law(0.005, 0.01),), (80.0,), transfer)
    samples = []
    for kelvin in (268.15, 283.15, 298.15):
        current = RANDOM.normal(1.0, 3.0, 3000)
        charge = np.linspace(1.0, 0.0, 3000)
        blank = Samples(
            np.ones(3000), current, current, current, np.full(3000, kelvin), charge, charge
        )
        voltage = truth.voltage_v(blank)
        ones = np.ones(3000)
        samples.append(Samples(ones, current, current, voltage, blank.temperature_k, charge, ones))
    structure = Structure(nodes, nodes, 0.05, 0.05, (80.0,), (), 1.0, 0.0, 0.02)
    found = fit_circuit(samples[::2], structure)
    np.testing.assert_allclose(found.open_circuit_v.values, ocv.values, atol=1e-3)
    assert found.ohmic.ohm(298.15, 0.5) == pytest.approx(0.03, rel=2e-2)
    # The temperature between those that were fitted.
    missed = found.voltage_v(samples[1]) - samples[1].voltage_v
    assert np.abs(missed).max() < 2e-3


def test_branch_current_follows_a_step_whatever_the_sampling() -> None:
    def after_a_minute(step_s: float) -> float:
        count = round(60.0 / step_s)
        ones = np.ones(count)
        samples = Samples(step_s * ones, ones, ones, ones, ones, ones, ones)
        return float(branch_current_a(samples, 30.0)[-1])

    assert after_a_minute(1.0) == pytest.approx(1.0 - np.exp(-2.0))
    assert after_a_minute(20.0) == pytest.approx(after_a_minute(1.0))


def test_law_of_pulses_is_found() -> None:
    kelvin = np.array([253.15, 263.15, 273.15, 283.15, 298.15])
    ohm = 0.02 + 0.01 * np.exp(-0.06 * (kelvin - 298.15))
    law = fit_pulse_law(list(zip(kelvin.tolist(), ohm.tolist(), strict=True)))
    assert law.coefficient_1_k == pytest.approx(0.06)
    assert law.ohm(268.15) == pytest.approx(0.02 + 0.01 * np.exp(1.8))


def test_one_drivetrain_is_found() -> None:
    truth = OneDrivetrain((), 0.88, 0.7)
    tests = pd.DataFrame(
        {"car": f"car {k}", "make": "Make", "cycle": cycle, "mass_kg": 1500.0 + 100 * k}
        for k in range(9)
        for cycle in ("udds", "hwfet")
    ).assign(constant_n=140, linear_n_s_m=3, quadratic_n_s2_m2=0.45)
    made = epa.consumption_wh_km(epa.wheel_energies_wh_km(tests), truth)
    found = fit_one_drivetrain(tests.assign(consumption_wh_km=made))
    assert len(found.fitted_on) == 6
    assert found.driving_efficiency == pytest.approx(0.88, rel=1e-4)
    assert found.recovered_share == pytest.approx(0.7, rel=1e-3)


def test_predicted_distance_agrees_with_an_integration() -> None:
    speed = np.array([20.0, 8.0, 3.0])
    acceleration = np.array([0.5, -1.0, -2.0])
    for lead_s in (1.0, 5.0, 10.0):
        times = np.linspace(0.0, lead_s, 20001)
        gone = 4.0 * (1.0 - np.exp(-times / 4.0))
        traces = np.maximum(speed[:, None] + acceleration[:, None] * gone, 0.0)
        expected = np.trapezoid(traces, times, axis=1)
        found = lead_vehicle.predicted_distance_m(speed, acceleration, lead_s)
        np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_braking_leader_falls_behind_and_gaps_are_not_bridged() -> None:
    speed = np.full(100, 20.0)
    speed[50:] = 15.0
    speed[80] = np.nan
    seen = lead_vehicle.observations(Drive("d", "d", Driver.ROAD, 1.0, speed))
    # Seen at 49 s, the speed is 17.5 m/s on average in the next second and 15 m/s then.
    row = 49 - 2
    np.testing.assert_allclose(seen.shortfall_m[row, :3], [2.5, 7.5, 12.5])
    assert np.isnan(seen.shortfall_m[79 - 2]).all()
    # From 60 s on the vehicle drives steadily, and the recording has no gap before 80 s.
    np.testing.assert_allclose(seen.shortfall_m[60 - 2], 0.0, atol=1e-9)


def test_bound_keeps_its_level_and_depends_on_the_state() -> None:
    drives = []
    for k in range(12):
        steps = RANDOM.normal(0.0, 1.0, 900)
        speed = np.clip(15.0 + 8.0 * np.sin(np.arange(900) / 90.0 + k) + steps, 1.0, None)
        drives.append(Drive(f"d{k}", f"d{k}", Driver.ROAD, 1.0, speed))
    seen = [lead_vehicle.observations(drive) for drive in drives]
    bound = lead_vehicle.fit_bound(seen[:8], Driver.ROAD)
    kept = lead_vehicle.coverage(seen[8:], bound)
    assert np.all(np.abs(kept.share() - 0.993) < 0.007)
    low, high = kept.interval()
    assert np.all((low <= kept.share()) & (kept.share() <= high))
    # A leader that accelerates falls further behind the prediction than one that brakes.
    width = bound.at(2, np.array([15.0, 15.0]), np.array([0.6, -1.0]))
    assert width[0] > width[1] >= 0.0


@pytest.mark.parametrize(
    ("value", "lowest", "highest", "met"),
    [
        (1.0, None, 1.0, True),
        (1.1, None, 1.0, False),
        (0.0, 0.0, None, True),
        (float("nan"), None, 1.0, False),
        (5.0, None, None, True),
        (-1.1, -1.0, 1.0, False),
    ],
)
def test_bar_of_a_figure(
    value: float, lowest: float | None, highest: float | None, met: bool
) -> None:
    assert Figure("quantity", "part", value, "%", lowest, highest).is_met is met

"""The models of the study by hand: consumers, branches, predictions and bars."""

import numpy as np
import pytest
from studies.validation.circuit import (
    ChargeTransfer,
    ResistanceLaw,
    Samples,
    ambient_temperature_rate_k_s,
    branch_current_a,
)
from studies.validation.drivers import observations
from studies.validation.epa import coast_down_force_n
from studies.validation.excerpts import Drive, Driver, Trip
from studies.validation.i3_drivetrain import (
    GEAR_RATIO,
    WHEEL_RADIUS_M,
    I3Drivetrain,
    consumers_w,
    objection_to,
)
from studies.validation.outcome import Figure

from iptm_core.physics.cell import ChargeTable
from iptm_drives.predictor_training import predicted_distance_m

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


def test_branch_current_follows_a_step_whatever_the_sampling() -> None:
    def after_a_minute(step_s: float) -> float:
        count = round(60.0 / step_s)
        ones = np.ones(count)
        samples = Samples(step_s * ones, ones, ones, ones, ones, ones)
        return float(branch_current_a(samples, 30.0)[-1])

    assert after_a_minute(1.0) == pytest.approx(1.0 - np.exp(-2.0))
    assert after_a_minute(20.0) == pytest.approx(after_a_minute(1.0))


def test_predicted_distance_agrees_with_an_integration() -> None:
    speed = np.array([20.0, 8.0, 3.0])
    acceleration = np.array([0.5, -1.0, -2.0])
    for lead_s in (1.0, 5.0, 10.0):
        times = np.linspace(0.0, lead_s, 20001)
        gone = 4.0 * (1.0 - np.exp(-times / 4.0))
        traces = np.maximum(speed[:, None] + acceleration[:, None] * gone, 0.0)
        expected = np.trapezoid(traces, times, axis=1)
        found = predicted_distance_m(speed, acceleration, lead_s)
        np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_braking_leader_falls_behind_and_gaps_are_not_bridged() -> None:
    speed = np.full(100, 20.0)
    speed[50:] = 15.0
    speed[80] = np.nan
    seen = observations(Drive("d", "d", Driver.ROAD, 1.0, speed))
    # Seen at 49 s, the speed is 17.5 m/s on average in the next second and 15 m/s then.
    row = 49 - 2
    np.testing.assert_allclose(seen.shortfall_m[row, :3], [2.5, 7.5, 12.5])
    assert np.isnan(seen.shortfall_m[79 - 2]).all()
    # From 60 s on the vehicle drives steadily, and the recording has no gap before 80 s.
    np.testing.assert_allclose(seen.shortfall_m[60 - 2], 0.0, atol=1e-9)


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


def test_resistance_law_has_an_offset_and_an_exponential() -> None:
    offset = ChargeTable((0.0, 1.0), (0.02, 0.02))
    exponential = ChargeTable((0.0, 1.0), (0.02, 0.01))
    law = ResistanceLaw(offset, exponential, 0.05, 298.15)
    assert law.ohm(298.15, 1.0) == pytest.approx(0.03)
    assert law.ohm(273.15, 0.5) == pytest.approx(0.02 + 0.015 * np.exp(1.25))


def test_charge_transfer_is_ohmic_for_small_and_logarithmic_for_large_currents() -> None:
    transfer = ChargeTransfer(ChargeTable((0.0, 1.0), (1.0, 1.0)), 0.5, 0.06, 298.15)
    thermal_v = 8.314462618 * 298.15 / 96485.33212
    small = transfer.voltage_v(1e-4, 298.15, 0.5)
    assert small == pytest.approx(thermal_v * 1e-4 / 0.5, rel=1e-6)
    decade = transfer.voltage_v(500.0, 298.15, 0.5) - transfer.voltage_v(50.0, 298.15, 0.5)
    assert decade == pytest.approx(2.0 * thermal_v * np.log(10.0), rel=1e-4)
    assert transfer.voltage_v(-3.0, 280.0, 0.5) == -transfer.voltage_v(3.0, 280.0, 0.5)
    assert transfer.voltage_v(1.0, 263.15, 0.5) > transfer.voltage_v(1.0, 298.15, 0.5)


def test_ambient_exchange_and_road_load_by_hand() -> None:
    rate = ambient_temperature_rate_k_s(500.0, 300.0, 290.0, 100_000.0, 20.0)
    assert rate == pytest.approx((500.0 - 200.0) / 100_000.0)
    force_n = coast_down_force_n(np.array([20.0]), 100.0, 2.0, 0.5)
    assert force_n == pytest.approx([100.0 + 40.0 + 200.0])

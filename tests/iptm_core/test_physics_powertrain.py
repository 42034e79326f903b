"""From motion to electric power and the pack's current: by hand, by the printed equations, and by bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import PowerLimitError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import RegenerationParameters
from iptm_core.physics.powertrain import (
    advance_position_m,
    advance_speed_m_s,
    battery_power_w,
    brake_release,
    cell_current_a,
    drag_loss_w,
    effective_source_voltage_v,
    extended_pack_current_a,
    motor_torque_nm,
    pack_current_a,
    pack_resistance_ohm,
    regenerative_torque_nm,
    traction_force_n,
    traction_power_w,
)

VALUES = load_parameters().values
BODY, POWERTRAIN = VALUES.body, VALUES.powertrain
RATIO_1_M = 2.80 * 3.789 / 0.28  # 37.89, wheel force per motor torque
LIMITS = RegenerationParameters(84.0, 50e3, 1.0, 2.0, 2.0, 0.5)
FORCES = st.floats(-6000.0, 6000.0)
SPEEDS = st.floats(0.0, 37.5)


@pytest.mark.parametrize(
    ("speed", "acceleration", "sine", "force"),
    [
        # 1432 * 9.8 * 0.015 = 210.504 N; 0.5 * 0.3 * 2.22 * 1.026 * 20^2 = 136.6632 N
        (0.0, 0.0, 0.0, 210.504),
        (20.0, 0.0, 0.0, 347.1672),
        # 1432 * 1.022 * 1.5 = 2195.256 N on top, both ways
        (20.0, 1.5, 0.0, 347.1672 + 2195.256),
        (20.0, -1.5, 0.0, 347.1672 - 2195.256),
        # 3 m in 5 m: sin = 0.6, cos = 0.8; weight 14033.6 N
        (0.0, 0.0, 0.6, 14033.6 * (0.6 + 0.015 * 0.8)),
        (0.0, 0.0, -0.6, 14033.6 * (-0.6 + 0.015 * 0.8)),
    ],
)
def test_force_by_hand(speed: float, acceleration: float, sine: float, force: float) -> None:
    found = traction_force_n(speed, acceleration, math.asin(sine), BODY)
    assert found == pytest.approx(force, rel=1e-12)


@given(
    speed=SPEEDS,
    acceleration=st.floats(-2.0, 2.0),
    first_s=st.floats(0.0, 10.0),
    second_s=st.floats(0.0, 10.0),
)
def test_two_short_steps_are_one_long_step(
    speed: float, acceleration: float, first_s: float, second_s: float
) -> None:
    half_way = advance_speed_m_s(speed, acceleration, first_s)
    position = advance_position_m(100.0, speed, acceleration, first_s)
    position = advance_position_m(position, half_way, acceleration, second_s)
    whole = first_s + second_s
    end = advance_speed_m_s(half_way, acceleration, second_s)
    assert end == pytest.approx(advance_speed_m_s(speed, acceleration, whole), abs=1e-12)
    assert position == pytest.approx(
        advance_position_m(100.0, speed, acceleration, whole), abs=1e-10
    )


def test_motion_by_hand() -> None:
    # from 10 m/s with -2 m/s^2 for 3 s: 10 - 6 = 4 m/s, 30 - 9 = 21 m
    assert advance_speed_m_s(10.0, -2.0, 3.0) == 4.0
    assert advance_position_m(5.0, 10.0, -2.0, 3.0) == 26.0


@given(FORCES)
def test_torque_is_the_printed_equation(force_n: float) -> None:
    """T_m = F_v r_w / (i_g i_0 eta_t^sign(F_v)); a lossless driveline has no kink to smooth."""
    sign = (force_n > 0.0) - (force_n < 0.0)
    assert motor_torque_nm(force_n, POWERTRAIN) == pytest.approx(
        force_n * 0.28 / (2.80 * 3.789 * 0.9**sign), rel=1e-13, abs=1e-300
    )
    lossless = replace(POWERTRAIN, driveline_efficiency=1.0)
    smooth = motor_torque_nm(force_n, lossless, force_smoothing_n=150.0)
    assert smooth == pytest.approx(force_n / RATIO_1_M, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("speed", "acceleration", "share"),
    [(0.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1e-9, 1.0), (1e-9, -2.0, 1.0), (20.0, 0.0, 1.0)],
)
def test_the_brakes_hold_only_without_motion_and_without_intent(
    speed: float, acceleration: float, share: float
) -> None:
    assert brake_release(speed, acceleration) == share


@given(speed=SPEEDS, width=st.floats(0.05, 1.0))
def test_the_smooth_brake_hold_withholds_a_known_share(speed: float, width: float) -> None:
    """Once rolling, the withheld share is s^2 / (v^2 + s^2)."""
    released = brake_release(speed, 0.0, speed_smoothing_m_s=width)
    assert 1.0 - released == pytest.approx(width**2 / (speed**2 + width**2), rel=1e-9, abs=1e-15)


def test_power_by_hand() -> None:
    # 10 N m at 20 m/s: 37.89 * 20 * 10 = 7578 W at the shaft, 0.873 * 100 = 87.3 W in copper
    assert traction_power_w(20.0, 10.0, POWERTRAIN) == pytest.approx(7665.3, rel=1e-12)
    assert traction_power_w(20.0, -10.0, POWERTRAIN) == pytest.approx(-7490.7, rel=1e-12)
    assert traction_power_w(0.0, -30.0, POWERTRAIN) == pytest.approx(0.873 * 900.0, rel=1e-12)


@given(force=FORCES, speed=SPEEDS)
def test_power_at_the_wheels_plus_the_losses_is_the_electric_power(
    force: float, speed: float
) -> None:
    """Driving: P = F v + driveline loss + copper loss; braking: the loss is kept from the motor."""
    torque = motor_torque_nm(force, POWERTRAIN)
    wheels = force * speed
    driveline = wheels * (1.0 / 0.9 - 1.0) if force > 0.0 else wheels * (0.9 - 1.0)
    assert driveline >= 0.0
    assert traction_power_w(speed, torque, POWERTRAIN) == pytest.approx(
        wheels + driveline + 0.873 * torque**2, rel=1e-12, abs=1e-9
    )


def test_drag_loss_has_the_same_value_in_both_directions() -> None:
    assert drag_loss_w(-200.0, 0.5, 0.002) == pytest.approx(100.0 + 80.0)
    assert drag_loss_w(200.0, 0.5, 0.002) == drag_loss_w(-200.0, 0.5, 0.002)


@pytest.mark.parametrize(
    ("demand", "motor_speed", "speed", "acceleration", "expected"),
    [
        (120.0, 300.0, 10.0, 1.0, 120.0),  # driving
        (-50.0, 300.0, 10.0, -1.0, -50.0),  # within all limits
        (-150.0, 300.0, 10.0, -1.5, -84.0),  # torque
        (-84.0, 1000.0, 35.0, -1.0, -50.0),  # power: 50 kW at 1000 rad/s
        (-50.0, 45.0, 1.5, -1.0, -42.0),  # half way through the blend
        (-50.0, 30.0, 0.9, -1.0, 0.0),  # friction brakes alone
        (-40.0, 300.0, 10.0, -3.0, -20.0),  # half of it beyond 2 m/s^2
        (-40.0, 300.0, 10.0, -6.0, 0.0),  # all of it
    ],
)
def test_regeneration_by_hand(
    demand: float, motor_speed: float, speed: float, acceleration: float, expected: float
) -> None:
    values = (demand, motor_speed, speed, acceleration)
    assert regenerative_torque_nm(*values, LIMITS) == pytest.approx(expected)
    arrays = [np.array([value]) for value in values]
    np.testing.assert_allclose(regenerative_torque_nm(*arrays, LIMITS), [expected])
    symbols = [ca.SX.sym(name) for name in "tmva"]
    function = ca.Function("torque", symbols, [regenerative_torque_nm(*symbols, LIMITS)])
    assert float(function(*values)) == pytest.approx(expected)


TRACTION = st.floats(-60e3, 90e3)
COMPRESSOR = st.floats(0.0, 4500.0)


def by_the_printed_cases(traction: float, compressor: float, efficiency: float) -> float:
    if traction >= 0.0:
        return (traction + compressor + 200.0) / efficiency
    return efficiency * 0.3 * traction + (compressor + 200.0) / efficiency


def test_by_hand() -> None:
    def at_terminals(traction: float, efficiency: float) -> float:
        pack = replace(VALUES.pack, battery_efficiency=efficiency)
        return float(battery_power_w(traction, 800.0, 200.0, pack, VALUES.powertrain))

    assert at_terminals(9000.0, 1.0) == 10000.0
    assert at_terminals(-9000.0, 1.0) == pytest.approx(-1700.0, rel=1e-12)
    assert at_terminals(8500.0, 0.95) == pytest.approx(10000.0, rel=1e-12)
    # 0.95 * 0.3 * -10000 + 1000 / 0.95 = -2850 + 1052.63
    assert at_terminals(-10000.0, 0.95) == pytest.approx(-1797.368421, rel=1e-9)
    assert at_terminals(0.0, 1.0) == 1000.0


@pytest.mark.parametrize("efficiency", [1.0, 0.95, 0.5])
@given(traction=TRACTION, compressor=COMPRESSOR)
def test_one_convex_kink_is_the_two_printed_cases(
    efficiency: float, traction: float, compressor: float
) -> None:
    pack = replace(VALUES.pack, battery_efficiency=efficiency)
    power = battery_power_w(traction, compressor, 200.0, pack, VALUES.powertrain)
    assert power == pytest.approx(
        by_the_printed_cases(traction, compressor, efficiency), rel=1e-13, abs=1e-9
    )


CELL, PACK = VALUES.cell, VALUES.pack
ISOTHERMAL_OCV = replace(CELL, entropic_coefficient_v_k=0.0)
POWERS = st.floats(-60e3, 100e3)
TEMPERATURES = st.floats(298.15, 313.15)
RESISTANCES = st.floats(0.05, 0.2)


def test_layout_by_hand() -> None:
    # 96 cells in series, 38 strings: 0.0608 ohm * 96 / 38 = 0.1536 ohm; 96 * 4e-4 = 0.0384 V/K
    assert PACK.cells_in_series == 96
    assert pack_resistance_ohm(0.0608, PACK) == pytest.approx(0.1536, rel=1e-12)
    # 380 V - 300 K * 0.0384 V/K = 368.48 V
    assert effective_source_voltage_v(300.0, CELL, PACK) == pytest.approx(368.48, rel=1e-12)
    assert cell_current_a(76.0, PACK) == 2.0


def test_power_and_current_by_hand() -> None:
    # 380 V * 100 A - 0.2 ohm * 100^2 A^2 = 36 kW, and back; -100 A charge with -40 kW
    assert pack_current_a(36e3, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(100.0, rel=1e-12)
    assert pack_current_a(-40e3, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(
        -100.0, rel=1e-12
    )
    assert pack_current_a(0.0, 0.2, 300.0, CELL, PACK) == 0.0


@given(power=POWERS, temperature=TEMPERATURES, resistance=RESISTANCES)
def test_chemical_power_is_terminal_power_plus_heat(
    power: float, temperature: float, resistance: float
) -> None:
    """E I = P_b + I^2 R + I T dV/dT to round-off, discharging and charging."""
    current = pack_current_a(power, resistance, temperature, CELL, PACK)
    ohmic = current**2 * resistance
    entropic = current * temperature * 96 * 4e-4
    chemical = 380.0 * current
    assert power + ohmic + entropic == pytest.approx(chemical, rel=1e-13, abs=1e-9)
    assert math.copysign(1.0, current) == math.copysign(1.0, power) or current == 0.0


@given(power=POWERS, temperature=TEMPERATURES, resistance=RESISTANCES)
def test_of_the_two_roots_the_small_current_is_taken(
    power: float, temperature: float, resistance: float
) -> None:
    voltage = effective_source_voltage_v(temperature, CELL, PACK)
    current = pack_current_a(power, resistance, temperature, CELL, PACK)
    assert current <= voltage / (2.0 * resistance)


@pytest.mark.parametrize("power", [1e-6, -1e-6, 1e-12])
def test_small_powers_lose_no_digits(power: float) -> None:
    """The printed root (E - sqrt(E^2 - 4 R P)) / (2 R) would cancel to a few digits here."""
    current = pack_current_a(power, 0.15, 300.0, CELL, PACK)
    first_order = power / 368.48
    assert current == pytest.approx(first_order, rel=1e-12)


def test_more_than_the_pack_can_deliver_is_refused_with_the_limit() -> None:
    # 380^2 / (4 * 0.2) = 180500 W
    limit = 380.0**2 / (4.0 * 0.2)
    assert pack_current_a(limit, 0.2, 300.0, ISOTHERMAL_OCV, PACK) == pytest.approx(
        380.0 / 0.4, rel=1e-6
    )
    with pytest.raises(PowerLimitError, match=r"180600\.0 W .* at most 180500\.0 W at 300\.00 K"):
        pack_current_a(limit + 100.0, 0.2, 300.0, ISOTHERMAL_OCV, PACK)
    with np.errstate(invalid="ignore"):
        both = pack_current_a(np.array([1e3, 2.0 * limit]), 0.2, 300.0, ISOTHERMAL_OCV, PACK)
    assert np.isnan(both).tolist() == [False, True]


@pytest.mark.parametrize("margin", [0.02, 0.1])
def test_an_optimiser_finds_a_current_for_any_power(margin: float) -> None:
    """Exact short of the largest power, by sqrt(margin) / 2 too small at it, convex and rising all along."""
    limit = 380.0**2 / (4.0 * 0.2)
    arguments = (0.2, 300.0, ISOTHERMAL_OCV, PACK)
    within = np.linspace(-3.0, 1.0 - margin, 200) * limit
    np.testing.assert_array_equal(
        extended_pack_current_a(within, *arguments, margin), pack_current_a(within, *arguments)
    )
    between = np.linspace(1.0 - margin, 1.0, 50) * limit
    share = extended_pack_current_a(between, *arguments, margin) / pack_current_a(
        between, *arguments
    )
    assert np.all(np.diff(share) < 0.0)
    assert share[-1] == pytest.approx(1.0 - 0.5 * math.sqrt(margin), rel=1e-6)
    power = np.linspace(-1.0, 4.0, 2001) * limit
    slope = np.diff(extended_pack_current_a(power, *arguments, margin)) / np.diff(power)
    assert slope[0] > 0.0
    assert np.all(np.diff(slope) > -1e-9 * slope[-1])
    # The steepest it gets: 1 / (380 V sqrt(margin)).
    assert slope[-1] == pytest.approx(1.0 / (380.0 * math.sqrt(margin)), rel=1e-6)

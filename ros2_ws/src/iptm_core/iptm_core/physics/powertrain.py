"""From the motion of the vehicle to the current of its pack, paper eqs. (1) to (7).

Road load, driveline, motor and regeneration give the electric traction power, eqs. (1) to (3) and (5). Beyond
the paper: losses that grow with speed, limits of regenerative braking and measured road loads, fitted to cars
in ``studies/validation``.

Terminal power and current of the pack follow from its equivalent circuit, eqs. (4), (6) and (7):
P_b = (E_b - T_b dV_b/dT_b) I_b - R_b I_b^2. Current is positive when discharging. The entropic term keeps the
paper's sign: with a positive ``dV/dT`` it draws on the terminal power and heats the cell on discharge, and
cools it on charge.
"""

from __future__ import annotations

from iptm_core.errors import PowerLimitError
from iptm_core.parameters.model import (
    BodyParameters,
    CellParameters,
    PackParameters,
    PowertrainParameters,
    RegenerationParameters,
)
from iptm_core.physics.ops import (
    Scalar,
    absolute,
    both,
    cos,
    is_symbolic,
    maximum,
    minimum,
    sin,
    sqrt,
    where,
)


def traction_force_n(
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    slope_rad: Scalar,
    body: BodyParameters,
) -> Scalar:
    """Force at the wheels that grade, rolling, air and inertia ask for (F_v, eq. 2), in N.

    It is positive when the vehicle has to be driven, negative when it has to be braked. Speeds are not
    negative, slopes positive uphill.
    """
    weight_n = body.mass_kg * body.gravity_m_s2
    grade = weight_n * sin(slope_rad)
    rolling = weight_n * body.rolling_resistance * cos(slope_rad)
    drag = (
        0.5
        * body.drag_coefficient
        * body.frontal_area_m2
        * body.air_density_kg_m3
        * speed_m_s
        * speed_m_s
    )
    inertia = body.mass_kg * body.rotational_inertia_factor * acceleration_m_s2
    return grade + rolling + drag + inertia


def advance_position_m(
    position_m: Scalar, speed_m_s: Scalar, acceleration_m_s2: Scalar, duration_s: float
) -> Scalar:
    """Position after a time of constant acceleration, exact solution of eq. (1)."""
    return position_m + duration_s * (speed_m_s + 0.5 * duration_s * acceleration_m_s2)


def advance_speed_m_s(speed_m_s: Scalar, acceleration_m_s2: Scalar, duration_s: float) -> Scalar:
    """Speed after a time of constant acceleration, exact solution of eq. (1)."""
    return speed_m_s + duration_s * acceleration_m_s2


def motor_torque_nm(
    force_n: Scalar, powertrain: PowertrainParameters, *, force_smoothing_n: float = 0.0
) -> Scalar:
    """Motor torque for a wheel force (T_m, eq. 3).

    The driveline loses on both ways: ``F eta^-sign(F)`` equals ``max(F / eta, F eta)``, which is the
    form used here because it is one convex kink.

    Args:
        force_smoothing_n: width of the smoothed kink in N of wheel force; 0 is exact.

    Returns:
        Torque in N m with the sign of the force.
    """
    efficiency = powertrain.driveline_efficiency
    # The two branches differ by F (1/eta - eta): the width is scaled so that it reads in newtons of F.
    width = force_smoothing_n * (1.0 / efficiency - efficiency)
    driven = maximum(force_n / efficiency, force_n * efficiency, width)
    ratio = powertrain.transmission_ratio * powertrain.final_drive_ratio
    return driven * powertrain.wheel_radius_m / ratio


def motor_speed_rad_s(speed_m_s: Scalar, powertrain: PowertrainParameters) -> Scalar:
    """Motor speed at a vehicle speed."""
    ratio = powertrain.transmission_ratio * powertrain.final_drive_ratio
    return speed_m_s * (ratio / powertrain.wheel_radius_m)


def brake_release(
    speed_m_s: Scalar, acceleration_m_s2: Scalar, *, speed_smoothing_m_s: float = 0.0
) -> Scalar:
    """Share of the motor torque that acts near standstill: 0 while the brakes hold, 1 when rolling.

    At v = 0 without commanded motion the brakes hold the vehicle, whatever the slope. The smoothed
    form depends on speed only and reaches one half at ``speed_smoothing_m_s``.
    """
    if speed_smoothing_m_s > 0.0:
        squared = speed_m_s * speed_m_s
        return squared / (squared + speed_smoothing_m_s * speed_smoothing_m_s)
    return where(both(speed_m_s <= 0.0, acceleration_m_s2 <= 0.0), 0.0, 1.0)


def drag_loss_w(
    motor_speed_rad_s: Scalar, linear_w_s_rad: float, quadratic_w_s2_rad2: float
) -> Scalar:
    """Loss of a turning motor without torque, bearings and hysteresis (c_1), eddy currents (c_2), in W."""
    speed = absolute(motor_speed_rad_s)
    return speed * (linear_w_s_rad + quadratic_w_s2_rad2 * speed)


def regenerative_torque_nm(
    torque_nm: Scalar,
    motor_speed_rad_s: Scalar,
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    limits: RegenerationParameters,
    *,
    torque_smoothing_nm: float = 0.0,
    speed_smoothing_m_s: float = 0.0,
) -> Scalar:
    """Motor torque for a demanded torque: braking is shared with the friction brakes.

    Args:
        torque_nm: demanded motor torque, negative when braking.
        acceleration_m_s2: acceleration of the vehicle, negative when braking.
        torque_smoothing_nm: width of the smoothed bound of the torque; 0 is exact.
        speed_smoothing_m_s: width of the smoothed ends of the blending; 0 is exact.

    Returns:
        Motor torque in N m; the friction brakes supply the difference.
    """
    blend_width = limits.blend_end_m_s - limits.blend_start_m_s
    blend_smoothing = speed_smoothing_m_s / blend_width
    blend = (speed_m_s - limits.blend_start_m_s) / blend_width
    blend = minimum(maximum(blend, 0.0, blend_smoothing), 1.0, blend_smoothing)
    beyond = maximum(-acceleration_m_s2 - limits.deceleration_m_s2, 0.0)
    share = maximum(1.0 - limits.decline_s2_m * beyond, 0.0)
    # Below one rad/s the power limit does not bind at any torque of a road vehicle.
    power_bound = limits.power_w / maximum(motor_speed_rad_s, 1.0)
    bound = blend * minimum(limits.torque_nm, power_bound, torque_smoothing_nm)
    braking = minimum(torque_nm, 0.0)
    return maximum(torque_nm + (share - 1.0) * braking, -bound, torque_smoothing_nm)


def traction_power_w(
    speed_m_s: Scalar, motor_torque: Scalar, powertrain: PowertrainParameters
) -> Scalar:
    """Electric power of the motor (P_tra, eq. 5), shaft and copper loss; negative when it feeds back."""
    ratio_1_m = (
        powertrain.transmission_ratio * powertrain.final_drive_ratio / powertrain.wheel_radius_m
    )
    copper_loss = powertrain.motor_loss_w_per_nm2 * motor_torque * motor_torque
    return ratio_1_m * speed_m_s * motor_torque + copper_loss


def battery_power_w(
    traction: Scalar,
    compressor: Scalar,
    auxiliary: Scalar,
    pack: PackParameters,
    powertrain: PowertrainParameters,
    *,
    power_smoothing_w: float = 0.0,
) -> Scalar:
    """Terminal power of the pack (P_b, eq. 4), positive when discharging.

    The two cases of the equation are one convex kink in the traction power,
    ``max(P_tra / eta_b, eta_b zeta P_tra)``.

    Args:
        traction: P_tra in W, like the compressor's P_cp and the auxiliary P_aux.
        power_smoothing_w: width of the smoothed kink in W of traction power; 0 is exact.
    """
    drive = 1.0 / pack.battery_efficiency
    regenerate = pack.battery_efficiency * powertrain.regenerative_efficiency
    width = power_smoothing_w * (drive - regenerate)
    share = maximum(traction * drive, traction * regenerate, width)
    return share + drive * (compressor + auxiliary)


def pack_resistance_ohm(cell_resistance_ohm: Scalar, pack: PackParameters) -> Scalar:
    """Pack resistance R_b of identical strings from the mean cell resistance."""
    return cell_resistance_ohm * (pack.cells_in_series / pack.parallel)


def effective_source_voltage_v(
    temperature_k: Scalar, cell: CellParameters, pack: PackParameters
) -> Scalar:
    """Voltage E_b - T_b dV_b/dT_b that delivers the terminal power of eq. (7) before ohmic loss."""
    entropic = cell.entropic_coefficient_v_k * pack.cells_in_series * temperature_k
    return pack.open_circuit_voltage_v - entropic


def pack_current_a(
    power_w: Scalar,
    resistance_ohm: Scalar,
    temperature_k: Scalar,
    cell: CellParameters,
    pack: PackParameters,
) -> Scalar:
    """Pack current that delivers a terminal power (I_b), the smaller root of eq. (7).

    Args:
        power_w: terminal power P_b, positive when discharging.

    Returns:
        Current in A. The root is written so that it stays exact for small powers.

    Raises:
        PowerLimitError: a float power is more than the pack can deliver; arrays and symbols give NaN.
    """
    voltage = effective_source_voltage_v(temperature_k, cell, pack)
    discriminant = voltage * voltage - 4.0 * resistance_ohm * power_w
    if not is_symbolic(discriminant) and isinstance(discriminant, float) and discriminant < 0.0:
        limit_w = largest_power_w(resistance_ohm, temperature_k, cell, pack)
        raise PowerLimitError(
            f"battery power {power_w:.1f} W cannot be delivered, the pack allows at most "
            f"{limit_w:.1f} W at {temperature_k:.2f} K"
        )
    return 2.0 * power_w / (voltage + sqrt(discriminant))


def terminal_power_w(
    current_a: Scalar,
    resistance_ohm: Scalar,
    temperature_k: Scalar,
    cell: CellParameters,
    pack: PackParameters,
) -> Scalar:
    """Terminal power of a pack current (eq. 7), in W."""
    return current_a * (
        effective_source_voltage_v(temperature_k, cell, pack) - resistance_ohm * current_a
    )


def largest_power_w(
    resistance_ohm: Scalar, temperature_k: Scalar, cell: CellParameters, pack: PackParameters
) -> Scalar:
    """Largest terminal power that the pack can deliver, where both roots of eq. (7) meet."""
    voltage = effective_source_voltage_v(temperature_k, cell, pack)
    return voltage * voltage / (4.0 * resistance_ohm)


def extended_pack_current_a(
    power_w: Scalar,
    resistance_ohm: Scalar,
    temperature_k: Scalar,
    cell: CellParameters,
    pack: PackParameters,
    margin: float,
) -> Scalar:
    """Pack current for any power, also more than the pack can deliver: for optimisers.

    Close to the largest power the root of eq. (7) becomes infinitely steep and beyond it there is none. From
    a margin below it on the current goes on along its tangent instead: it stays convex and rising, so that
    asking for more than there is never pays, and its derivatives stay bounded.

    Args:
        margin: share of the largest power, in (0, 1).

    Returns:
        Current in A: exact up to ``(1 - margin)`` of the largest power, and at that power itself too small
        by the share ``sqrt(margin) / 2``.
    """
    voltage = effective_source_voltage_v(temperature_k, cell, pack)
    bound_w = (1.0 - margin) * largest_power_w(resistance_ohm, temperature_k, cell, pack)
    within_w = -maximum(-power_w, -bound_w)
    current = pack_current_a(within_w, resistance_ohm, temperature_k, cell, pack)
    # The slope of the root, 1 / sqrt(voltage^2 - 4 resistance power), where it is left.
    return current + (power_w - within_w) / (voltage * margin**0.5)


def cell_current_a(pack_current: Scalar, pack: PackParameters) -> Scalar:
    """Current of one cell, I_b / N_mp, all strings sharing evenly."""
    return pack_current / pack.parallel

"""Terminal power, current and equivalent circuit of the pack, paper eqs. (4), (6) and (7).

P_b = (E_b - T_b dV_b/dT_b) I_b - R_b I_b^2. Current is positive when discharging. The entropic term
keeps the paper's sign: with a positive ``dV/dT`` it draws on the terminal power and heats the cell on
discharge, and cools it on charge.
"""

from __future__ import annotations

from iptm_core.errors import PowerLimitError
from iptm_core.parameters.model import CellParameters, PackParameters, PowertrainParameters
from iptm_core.physics.ops import Scalar, is_symbolic, maximum, sqrt


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

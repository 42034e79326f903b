"""Checks between parameters: numbers that are fine alone and nonsense together."""

from __future__ import annotations

from itertools import pairwise

from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters


def check_consistency(values: ModelParameters, origin: str = "parameters") -> None:
    """Refuse parameters that contradict each other.

    Args:
        values: parameters that are each inside their range.
        origin: where they come from, for the message.

    Raises:
        ParameterError: naming the dotted keys, their values and what is permitted.
    """
    _check_order(values, origin)
    _check_channel(values, origin)
    _check_cell(values, origin)
    _check_charge(values, origin)


def _check_order(values: ModelParameters, origin: str) -> None:
    pairs = [
        ("limits", f"min_{quantity}", f"max_{quantity}")
        for quantity in ("acceleration_m_s2", "compressor_power_w", "speed_m_s", "temperature_k")
    ]
    others = [
        ("gap", "standstill_gap_m", "max_gap_m"),
        ("regeneration", "blend_start_m_s", "blend_end_m_s"),
        ("charge", "min_charge", "initial_charge"),
    ]
    for group, low_name, high_name in (*pairs, *others):
        low: float = getattr(getattr(values, group), low_name)
        high: float = getattr(getattr(values, group), high_name)
        if low >= high:
            raise ParameterError(
                f"{origin}: {group}.{low_name} is {low!r}; "
                f"allowed: below {group}.{high_name} = {high!r}"
            )
    if values.brakes.max_deceleration_m_s2 < -values.limits.min_acceleration_m_s2:
        raise ParameterError(
            f"{origin}: brakes.max_deceleration_m_s2 is {values.brakes.max_deceleration_m_s2!r}; allowed: "
            f"from the comfort limit, -limits.min_acceleration_m_s2 = "
            f"{-values.limits.min_acceleration_m_s2!r} m/s^2"
        )
    gap = values.gap
    if not gap.standstill_gap_m <= gap.initial_gap_m <= gap.max_gap_m:
        raise ParameterError(
            f"{origin}: gap.initial_gap_m is {gap.initial_gap_m!r}; allowed: from "
            f"gap.standstill_gap_m to gap.max_gap_m, {gap.standstill_gap_m!r} to {gap.max_gap_m!r} m"
        )


def _check_channel(values: ModelParameters, origin: str) -> None:
    cooling = values.cooling
    # Heat-capacity rate of one channel (W/K); never scaled with a sampling time.
    flow_w_k = (
        cooling.coolant_specific_heat_j_kg_k * cooling.coolant_mass_flow_kg_s / values.pack.modules
    )
    ratio = cooling.convective_coefficient_w_k / flow_w_k
    if ratio >= 1.0:
        raise ParameterError(
            f"{origin}: cooling.convective_coefficient_w_k = "
            f"{cooling.convective_coefficient_w_k!r} is not below the heat-capacity rate of one "
            f"coolant channel, {flow_w_k:.6g} W/K (cooling.coolant_specific_heat_j_kg_k "
            f"cooling.coolant_mass_flow_kg_s / pack.modules): h/C_f = {ratio:.6g}, allowed: below 1, "
            "or the coolant would overshoot the cell it passes"
        )
    chiller = values.chiller
    slope_w_k = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * cooling.coolant_mass_flow_kg_s
    if slope_w_k < 0.0:
        raise ParameterError(
            f"{origin}: chiller.xi_3_w_k + chiller.xi_5_j_kg_k cooling.coolant_mass_flow_kg_s = "
            f"{slope_w_k:.6g} W/K; allowed: 0 or more, or the chiller would cool less the warmer the "
            "coolant is (the coefficients belong to the coolant flow that they were fitted at)"
        )


def _check_cell(values: ModelParameters, origin: str) -> None:
    cell = values.cell
    kappa = cell.resistance_temperature_coefficient_1_k
    temperatures_k = {
        "limits.min_temperature_k": values.limits.min_temperature_k,
        "limits.max_temperature_k": values.limits.max_temperature_k,
        "environment.initial_cell_temperature_k": values.environment.initial_cell_temperature_k,
    }
    for key, temperature_k in temperatures_k.items():
        factor = 1.0 + kappa * (temperature_k - cell.nominal_temperature_k)
        if factor <= 0.0 and cell.resistance_exponent_1_k == 0.0:
            raise ParameterError(
                f"{origin}: cell.resistance_temperature_coefficient_1_k = {kappa!r} makes the cell "
                f"resistance vanish at {key} = {temperature_k!r}: factor {factor:.6g}, allowed: above 0"
            )
        entropic_v = values.pack.cells_in_series * temperature_k * cell.entropic_coefficient_v_k
        lowest_v = values.pack.open_circuit_voltage_v * min(values.charge.voltage_shares)
        if entropic_v >= lowest_v:
            raise ParameterError(
                f"{origin}: cell.entropic_coefficient_v_k = {cell.entropic_coefficient_v_k!r} gives an "
                f"entropic voltage of {entropic_v:.6g} V at {key} = {temperature_k!r}; allowed: below "
                f"pack.open_circuit_voltage_v = {lowest_v!r}"
            )


def _check_charge(values: ModelParameters, origin: str) -> None:
    shares = values.charge.voltage_shares
    for below, (low, high) in enumerate(pairwise(shares)):
        if high < low:
            raise ParameterError(
                f"{origin}: charge.voltage_share_{10 * below + 10} is {high!r}; allowed: at least "
                f"charge.voltage_share_{10 * below} = {low!r}, the voltage rises with the charge"
            )

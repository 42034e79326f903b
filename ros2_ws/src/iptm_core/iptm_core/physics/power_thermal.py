"""All effects put together: from speed, inputs and cell states to powers and rates, eqs. (2) to (15).

Parameters are those at a state of charge, see ``at_charge``.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import has_effect
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import (
    capacity_loss_rate_1_s,
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
    heat_from_air_w,
)
from iptm_core.physics.chiller import chiller_line
from iptm_core.physics.ops import Scalar, excess
from iptm_core.physics.powertrain import (
    battery_power_w,
    brake_release,
    cell_current_a,
    drag_loss_w,
    extended_pack_current_a,
    motor_speed_rad_s,
    motor_torque_nm,
    pack_current_a,
    pack_resistance_ohm,
    regenerative_torque_nm,
    traction_force_n,
    traction_power_w,
)
from iptm_core.physics.thermal_loop import (
    Channel,
    CoolantLoop,
    solve_coolant_loop,
    thermal_actuation,
)


@dataclass(frozen=True)
class Smoothing:
    """Widths of the smoothed kinks; all zero is the exact model.

    Attributes:
        force_n: sign change of the wheel force in the driveline efficiency.
        power_w: switch from driving to regeneration.
        speed_m_s: brake hold at standstill.
        blend_m_s: ends of the blending between motor and friction brakes.
        cooling_w: bound of the cooling rate at zero.
        actuator_w: sign change of the power of the thermal actuator.
        deliverable_margin: part of the largest power that the pack can deliver over which the current leaves
            its root for a tangent, see ``extended_pack_current_a``.
    """

    force_n: float = 0.0
    power_w: float = 0.0
    c_rate_1_h: float = 0.0
    speed_m_s: float = 0.0
    cooling_w: float = 0.0
    actuator_w: float = 0.0
    deliverable_margin: float = 0.0
    torque_nm: float = 0.0
    blend_m_s: float = 0.0

    def scaled(self, factor: float) -> Smoothing:
        """Return all widths times a factor."""
        return Smoothing(**{name: factor * width for name, width in vars(self).items()})


EXACT = Smoothing()


@dataclass(frozen=True)
class CellPair:
    """Temperatures (K) and capacity losses (fraction) of the first and the last cell of a channel."""

    cell_1_temperature_k: Scalar
    cell_n_temperature_k: Scalar
    cell_1_capacity_loss: Scalar
    cell_n_capacity_loss: Scalar


@dataclass(frozen=True)
class PowerThermalRates:
    """What the model answers at one instant: powers (W), currents (A), coolant (K) and rates (1/s)."""

    traction_power_w: Scalar
    battery_power_w: Scalar
    pack_current_a: Scalar
    cell_current_a: Scalar
    coolant: CoolantLoop
    cell_1_temperature_rate_k_s: Scalar
    cell_n_temperature_rate_k_s: Scalar
    cell_1_capacity_loss_rate_1_s: Scalar
    cell_n_capacity_loss_rate_1_s: Scalar


def electric_traction_power_w(
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    slope_rad: Scalar,
    parameters: ModelParameters,
    smoothing: Smoothing = EXACT,
) -> Scalar:
    """Traction power from motion and slope (eqs. 2, 3 and 5) with the brake hold at standstill.

    Where they are given, the limits of regeneration bound the torque, and the drag loss is added.
    """
    powertrain = parameters.powertrain
    force = traction_force_n(speed_m_s, acceleration_m_s2, slope_rad, parameters.body)
    torque = motor_torque_nm(force, powertrain, force_smoothing_n=smoothing.force_n)
    if parameters.regeneration.limited:
        torque = regenerative_torque_nm(
            torque,
            motor_speed_rad_s(speed_m_s, powertrain),
            speed_m_s,
            acceleration_m_s2,
            parameters.regeneration,
            torque_smoothing_nm=smoothing.torque_nm,
            speed_smoothing_m_s=smoothing.blend_m_s,
        )
    released = brake_release(speed_m_s, acceleration_m_s2, speed_smoothing_m_s=smoothing.speed_m_s)
    power = traction_power_w(speed_m_s, released * torque, powertrain)
    if has_effect(powertrain.drag_loss_w_s2_rad2):
        turning = motor_speed_rad_s(speed_m_s, powertrain)
        power = power + drag_loss_w(turning, 0.0, powertrain.drag_loss_w_s2_rad2)
    return power


def power_thermal_rates(
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    slope_rad: Scalar,
    compressor_power_w: Scalar,
    cells: CellPair,
    parameters: ModelParameters,
    channel: Channel,
    smoothing: Smoothing = EXACT,
    charge_w: Scalar | None = None,
) -> PowerThermalRates:
    """Evaluate the coupled model at one instant of a motion; a negative power drives the heater.

    Args:
        charge_w: see `rates_at_traction_power`.
    """
    traction = electric_traction_power_w(
        speed_m_s, acceleration_m_s2, slope_rad, parameters, smoothing
    )
    return rates_at_traction_power(
        traction, speed_m_s, compressor_power_w, cells, parameters, channel, smoothing, charge_w
    )


def rates_at_traction_power(
    traction: Scalar,
    speed_m_s: Scalar,
    compressor_power_w: Scalar,
    cells: CellPair,
    parameters: ModelParameters,
    channel: Channel,
    smoothing: Smoothing = EXACT,
    charge_w: Scalar | None = None,
) -> PowerThermalRates:
    """Evaluate the model where the traction power P_tra (W) is known and the motion behind it is not.

    Args:
        charge_w: largest charging power at the terminals, beyond which friction brakes take what the motor
            would feed back; with a width of `Smoothing.power_w`. The capacity losses are those without the
            limit: what friction takes has to be charged again, which ages the cells in its place. Without
            that an optimum of ageing would brake by friction to spare the pack. None: no limit.
    """
    pack, cell = parameters.pack, parameters.cell
    actuation = thermal_actuation(compressor_power_w, parameters, smoothing.actuator_w)
    terminal = battery_power_w(
        traction,
        actuation.drawn_w,
        parameters.cooling.auxiliary_power_w,
        pack,
        parameters.powertrain,
        power_smoothing_w=smoothing.power_w,
    )
    t_1, t_n = cells.cell_1_temperature_k, cells.cell_n_temperature_k
    r_1 = cell_resistance_ohm(t_1, cells.cell_1_capacity_loss, cell)
    r_n = cell_resistance_ohm(t_n, cells.cell_n_capacity_loss, cell)
    # Cells along a channel are taken as evenly spread between the first and the last.
    mean_resistance = pack_resistance_ohm(0.5 * (r_1 + r_n), pack)
    mean_temperature = 0.5 * (t_1 + t_n)
    at_terminals = (mean_resistance, mean_temperature, cell, pack)

    def current_at(power: Scalar) -> Scalar:
        if smoothing.deliverable_margin > 0.0:
            return extended_pack_current_a(power, *at_terminals, smoothing.deliverable_margin)
        return pack_current_a(power, *at_terminals)

    current_b = current_at(terminal)
    current = wearing = cell_current_a(current_b, pack)
    if charge_w is not None:
        terminal = terminal + excess(-charge_w - terminal, smoothing.power_w)
        current_b = current_at(terminal)
        current = cell_current_a(current_b, pack)

    line = chiller_line(
        actuation.compressor_w,
        speed_m_s,
        parameters.chiller,
        parameters.cooling,
        parameters.environment,
    )
    loop = solve_coolant_loop(
        t_1, t_n, line, channel.outlet, parameters.cooling, smoothing.cooling_w, actuation
    )
    coolant_n = channel.last_cell.temperature_k(loop.inlet_k, t_1, t_n)

    def temperature_rate(temperature: Scalar, resistance: Scalar, coolant: Scalar) -> Scalar:
        heat = cell_heat_w(current, resistance, temperature, cell)
        heat = heat + heat_from_air_w(temperature, parameters)
        return cell_temperature_rate_k_s(heat, temperature, coolant, cell, parameters.cooling)

    def loss_rate(temperature: Scalar, loss: Scalar) -> Scalar:
        return capacity_loss_rate_1_s(
            wearing,
            temperature,
            loss,
            parameters.aging,
            cell,
            current_smoothing_a=smoothing.c_rate_1_h * cell.nominal_capacity_ah,
        )

    return PowerThermalRates(
        traction_power_w=traction,
        battery_power_w=terminal,
        pack_current_a=current_b,
        cell_current_a=current,
        coolant=loop,
        cell_1_temperature_rate_k_s=temperature_rate(t_1, r_1, loop.inlet_k),
        cell_n_temperature_rate_k_s=temperature_rate(t_n, r_n, coolant_n),
        cell_1_capacity_loss_rate_1_s=loss_rate(t_1, cells.cell_1_capacity_loss),
        cell_n_capacity_loss_rate_1_s=loss_rate(t_n, cells.cell_n_capacity_loss),
    )

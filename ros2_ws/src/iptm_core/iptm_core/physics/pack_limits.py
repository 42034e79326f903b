"""Power limits of a pack: limits of current, cell voltage and charge, as terminal powers.

The paper's pack takes any power at any charge. Here the largest currents are tables over temperature (per
hour of the capacity) times shares over the state of charge, and no cell may leave its limits of voltage.
Within an interval no pack may be charged beyond full or discharged beyond empty, the paper's included.

Current and power are positive when discharging.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from iptm_core.parameters.model import ModelParameters, PackLimitParameters
from iptm_core.physics.cell import ChargeTable, at_charge, cell_resistance_ohm, pack_capacity_ah
from iptm_core.physics.ops import Scalar, maximum, minimum, where
from iptm_core.physics.power_thermal import CellPair
from iptm_core.physics.powertrain import (
    effective_source_voltage_v,
    largest_power_w,
    pack_resistance_ohm,
    terminal_power_w,
)
from iptm_core.physics.thermal_loop import thermal_actuation
from iptm_core.units import CELSIUS_ZERO_K, SECONDS_PER_HOUR

VOLTAGE_MARGIN_V = 1e-3
"""Kept from the limits of cell voltage, as temperature and charge change within an interval."""
_CHARGE_NODES = (0.7, 0.8, 0.9, 1.0)
_DISCHARGE_NODES = (0.0, 0.1, 0.2, 0.3)
_PARTS = 2**24


@dataclass(frozen=True)
class PowerLimits:
    """Terminal powers that a pack takes and gives; infinite without limits.

    Attributes:
        charge_w: largest charging power, not negative.
        discharge_w: largest discharging power, not negative.
    """

    charge_w: float = math.inf
    discharge_w: float = math.inf

    def reduced(self, share: float) -> PowerLimits:
        """Return both times a share."""
        return PowerLimits(share * self.charge_w, share * self.discharge_w)


UNLIMITED = PowerLimits()


@dataclass(frozen=True)
class _TemperatureTable:
    nodes_k: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, temperature_k: Scalar) -> Scalar:
        """Return the value at a temperature, linear between the nodes and constant outside."""
        return ChargeTable(self.nodes_k, self.values).at(temperature_k)


def current_limits_a(
    cells: CellPair, charge: Scalar, parameters: ModelParameters
) -> tuple[Scalar, Scalar]:
    """Return least and largest pack current in A by temperature, charge and cell voltage.

    Args:
        charge: state of charge, 0 to 1.
        parameters: those at that charge, see ``at_charge``.
    """
    limits, pack = parameters.pack_limits, parameters.pack
    capacity_ah = parameters.cell.nominal_capacity_ah * pack.parallel
    temperatures_k = cells.cell_1_temperature_k, cells.cell_n_temperature_k
    losses = cells.cell_1_capacity_loss, cells.cell_n_capacity_loss
    charging, discharging = (
        capacity_ah
        * minimum(*(_TemperatureTable(_NODES_K, rates).at(each) for each in temperatures_k))
        for rates in (limits.charge_rates_1_h, limits.discharge_rates_1_h)
    )
    charging *= ChargeTable(_CHARGE_NODES, (1.0, *limits.charge_shares)).at(charge)
    discharging *= ChargeTable(_DISCHARGE_NODES, (*limits.discharge_shares, 1.0)).at(charge)
    for temperature_k, loss in zip(temperatures_k, losses, strict=True):
        source_v = pack.open_circuit_voltage_v / pack.cells_in_series
        source_v -= parameters.cell.entropic_coefficient_v_k * temperature_k
        ohm = cell_resistance_ohm(temperature_k, loss, parameters.cell) / pack.parallel
        below_v = limits.max_cell_voltage_v - VOLTAGE_MARGIN_V - source_v
        above_v = source_v - limits.min_cell_voltage_v - VOLTAGE_MARGIN_V
        charging = minimum(charging, maximum(below_v, 0.0) / ohm)
        discharging = minimum(discharging, maximum(above_v, 0.0) / ohm)
    # Shares end at 0 but for rounding.
    return -maximum(charging, 0.0), maximum(discharging, 0.0)


def power_limits(
    cells: CellPair, charge: float, parameters: ModelParameters, duration_s: float
) -> PowerLimits:
    """Return what a pack takes and gives for an interval.

    Args:
        charge: state of charge, 0 to 1; NaN, not known, is that at which a trip begins.
        parameters: of the pack, at any charge.
        duration_s: length of the interval, at the end of which the pack may be full or empty.
    """
    if math.isnan(charge):
        charge = parameters.charge.initial_charge
    return PowerLimits(*map(float, terminal_limits_w(cells, charge, parameters, duration_s)))


def terminal_limits_w(
    cells: CellPair, charge: Scalar, parameters: ModelParameters, duration_s: Scalar
) -> tuple[Scalar, Scalar]:
    """Return the charging and discharging power of `power_limits`, of numbers or expressions."""
    charge = minimum(maximum(charge, 0.0), 1.0)
    parameters = at_charge(parameters, charge)
    pack, cell = parameters.pack, parameters.cell
    t_1, t_n = cells.cell_1_temperature_k, cells.cell_n_temperature_k
    loss_1, loss_n = cells.cell_1_capacity_loss, cells.cell_n_capacity_loss
    least_a, most_a = current_limits_a(cells, charge, parameters)
    content_as = SECONDS_PER_HOUR * pack_capacity_ah(parameters, 0.5 * (loss_1 + loss_n))
    least_a = maximum(least_a, -(1.0 - charge) * content_as / duration_s)
    most_a = minimum(most_a, charge * content_as / duration_s)
    mean_ohm = pack_resistance_ohm(
        0.5 * (cell_resistance_ohm(t_1, loss_1, cell) + cell_resistance_ohm(t_n, loss_n, cell)),
        pack,
    )
    mean_k = 0.5 * (t_1 + t_n)
    at_terminals = mean_ohm, mean_k, cell, pack
    # Beyond this current the power falls again.
    peak_a = effective_source_voltage_v(mean_k, cell, pack) / (2.0 * mean_ohm)
    discharge_w = where(
        most_a >= peak_a, largest_power_w(*at_terminals), terminal_power_w(most_a, *at_terminals)
    )
    # Charging power is not negative; it is 0 at no current.
    return 0.0 - terminal_power_w(least_a, *at_terminals), discharge_w


def least_traction_power_w(
    charge_w: Scalar, thermal_power_w: Scalar, parameters: ModelParameters
) -> Scalar:
    """Return the traction power (P_tra, negative) down to which the motor may feed back.

    Args:
        charge_w: largest charging power at the terminals; auxiliaries and thermal actuator use what the
            motor feeds back first.
        thermal_power_w: of the thermal actuator, negative for the heater.
    """
    pack, powertrain = parameters.pack, parameters.powertrain
    regenerated = pack.battery_efficiency * powertrain.regenerative_efficiency
    if regenerated <= 0.0:
        return -math.inf
    drawn_w = thermal_actuation(thermal_power_w, parameters).drawn_w
    used_w = (drawn_w + parameters.cooling.auxiliary_power_w) / pack.battery_efficiency
    return -(charge_w + used_w) / regenerated


_NODES_K = tuple(CELSIUS_ZERO_K + node for node in PackLimitParameters.NODES_C)


def largest_within(excess: Callable[[float], float], low: float, high: float) -> float:
    """Return the largest argument at which an increasing excess is not positive, to 2**-24 of the range.

    By false position in whole parts of the range; the excess of an end that stays twice is halved (Illinois).

    Args:
        excess: amount above a limit.
        low: returned where the limit is exceeded everywhere.
        high: returned where it is not exceeded.
    """
    above, below = excess(high), excess(low)
    if above <= 0.0:
        return high
    if below > 0.0:
        return low
    step, first, last, moved = (high - low) / _PARTS, 0, _PARTS, 0
    while last - first > 1:
        between = first + round((last - first) * below / (below - above))
        between = min(max(between, first + 1), last - 1)
        found = excess(low + step * between)
        side = 1 if found > 0.0 else -1
        stayed = 0.5 if side == moved else 1.0
        if side < 0:
            first, below, above = between, found, above * stayed
        else:
            last, above, below = between, found, below * stayed
        moved = side
    return low + step * first

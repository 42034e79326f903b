"""Integration of all cells of a coolant channel over one interval of prescribed motion.

What is fast is common to all cells, and what is many is slow. So motion and current are evaluated at every
sub-step and integrated with Simpson's rule, while the cells take one explicit midpoint step for many
sub-steps, at the means over the currents. Both get finer together; the order is two. Heat, cooling and
change of temperature balance to rounding, whatever the step.

As for two cells, a step is unrolled once into an expression graph of the functions of `iptm_core.physics`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import (
    at_charge,
    capacity_loss_rate_1_s,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
    heat_from_air_w,
)
from iptm_core.physics.chiller import chiller_line
from iptm_core.physics.ops import BufferedFunction, Scalar, maximum, named_function
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.physics.powertrain import (
    battery_power_w,
    cell_current_a,
    pack_current_a,
    pack_resistance_ohm,
)
from iptm_core.physics.thermal_loop import (
    CoolantLoop,
    FullChannel,
    mean_cell_heat_w,
    solve_coolant_loop,
    thermal_actuation,
)
from iptm_core.state import ChannelCells, FloatArray
from iptm_plant_sim.actuators import Motion
from iptm_plant_sim.interval import (
    INTEGRALS,
    IntervalResult,
    PowerBounds,
    bound_symbols,
    cell_voltage_v,
    deliverable,
)

SUB_STEPS_PER_CELL_STEP = 20
"""One second at the default integration step, a hundredth of the time constant of a cell."""

_SIMPSON = ca.DM([1.0, 4.0, 1.0]) / 6.0


class ChannelIntegrator:
    """Integrates intervals of any number of sub-steps for one parameter set; see `IntervalIntegrator`."""

    def __init__(self, parameters: ModelParameters, *, bounded: bool = False) -> None:
        self._parameters = parameters
        self._bounded = bounded
        self._steps: dict[int, BufferedFunction] = {}

    def integrate(
        self,
        cells: ChannelCells,
        compressor_power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        charge: float = math.nan,
        bounds: PowerBounds | None = None,
    ) -> IntervalResult:
        """Integrate one interval.

        Args:
            cells: all cells at the start.
            motion: the motion, laid out for n sub-steps.
            slopes_rad: slope at ``motion.positions_m``, shape (2 n + 1,).
            charge: state of charge at the start; NaN where nothing depends on it.
            bounds: of the interval, where it is bounded.
        """
        temperatures_k, capacity_losses = cells.temperatures_k, cells.capacity_losses
        totals = dict.fromkeys(INTEGRALS, 0.0)
        end: dict[str, float] = {}
        for first in range(0, motion.lengths_s.size, SUB_STEPS_PER_CELL_STEP):
            cut = slice(first, first + SUB_STEPS_PER_CELL_STEP)
            lengths_s = motion.lengths_s[cut]
            step = self._step(lengths_s.size)
            given, results = step.arguments, step.results
            given["start_temperatures_k"][:] = temperatures_k
            given["start_capacity_losses"][:] = capacity_losses
            given["compressor_power_w"][0] = compressor_power_w
            given["lengths_s"][:] = lengths_s
            given["accelerations_m_s2"][:] = motion.accelerations_m_s2[cut]
            given["slopes_rad"][:] = slopes_rad[2 * first : 2 * (first + lengths_s.size) + 1]
            given["speeds_m_s"][:] = motion.speeds_m_s[cut].ravel()
            given["charge"][0] = charge
            if bounds is not None:
                given["least_traction_w"][0] = bounds.traction_w
                given["most_battery_w"][0] = bounds.battery_w
            step()
            temperatures_k = results["temperatures_k"].copy()
            capacity_losses = results["capacity_losses"].copy()
            end = {name: float(value[0]) for name, value in results.items() if value.size == 1}
            totals = {name: total + end[name] for name, total in totals.items()}
        return IntervalResult(
            cell_1_temperature_k=float(temperatures_k[0]),
            cell_n_temperature_k=float(temperatures_k[-1]),
            cell_1_capacity_loss=float(capacity_losses[0]),
            cell_n_capacity_loss=float(capacity_losses[-1]),
            **(end | totals),
            channel=ChannelCells(temperatures_k, capacity_losses),
        )

    def _step(self, sub_steps: int) -> BufferedFunction:
        if sub_steps not in self._steps:
            self._steps[sub_steps] = BufferedFunction(
                _build(self._parameters, sub_steps, bounded=self._bounded)
            )
        return self._steps[sub_steps]


def _motion_symbols(n: int) -> dict[str, ca.SX]:
    """Return the symbols of compressor power, charge and motion of an interval of n sub-steps."""
    sizes = {
        "compressor_power_w": 1,
        "lengths_s": n,
        "accelerations_m_s2": n,
        "slopes_rad": 2 * n + 1,
        "speeds_m_s": 3 * n,
        "charge": 1,
    }
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


@lru_cache(maxsize=16)
def _build(parameters: ModelParameters, n: int, *, bounded: bool = False) -> ca.Function:
    """Return one step of all cells over n sub-steps, which also answers the fields of `IntervalResult`."""
    cooling = parameters.cooling
    channel = FullChannel.of(cooling, parameters.pack)
    count = channel.cells
    before, losses_before = ca.SX.sym("temperatures_k", count), ca.SX.sym("capacity_losses", count)
    bounds = bound_symbols() if bounded else {}
    given = _motion_symbols(n) | bounds
    lengths, speeds = given["lengths_s"], given["speeds_m_s"]
    parameters = at_charge(parameters, given["charge"])
    pack, cell = parameters.pack, parameters.cell
    instants = [(step, stage) for step in range(n) for stage in range(3)]
    traction = electric_traction_power_w(
        speeds,
        ca.vertcat(*(given["accelerations_m_s2"][step] for step, _ in instants)),
        ca.vertcat(*(given["slopes_rad"][2 * step + stage] for step, stage in instants)),
        parameters,
    )
    if bounds:
        traction = maximum(traction, bounds["least_traction_w"])
    actuation = thermal_actuation(given["compressor_power_w"], parameters)
    battery = battery_power_w(
        traction, actuation.drawn_w, cooling.auxiliary_power_w, pack, parameters.powertrain
    )
    chiller = chiller_line(
        actuation.compressor_w, speeds, parameters.chiller, cooling, parameters.environment
    )
    weights = ca.vec(ca.mtimes(_SIMPSON, lengths.T))
    length = ca.dot(ca.DM.ones(n), lengths)
    # An interval of no length, where only the end counts, has means all the same.
    shares = ca.if_else(length > 0.0, weights / length, 1.0 / (3 * n))

    def mean_of(cells: Scalar) -> Scalar:
        return ca.dot(ca.DM.ones(count), cells) / count

    def pack_currents(at: Scalar, aged: Scalar, power: Scalar) -> Scalar:
        resistance = pack_resistance_ohm(mean_of(cell_resistance_ohm(at, aged, cell)), pack)
        return pack_current_a(power, resistance, mean_of(at), cell, pack)

    def coolant_loop(at: Scalar) -> CoolantLoop:
        equivalent = channel.equivalent_cell_k(at)
        return solve_coolant_loop(
            equivalent, equivalent, chiller, channel.outlet, cooling, actuation=actuation
        )

    def means(at: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        """Pack currents at the instants; means of heat, temperature rates and cooling rate over them."""
        pack_current = pack_currents(at, losses_before, battery)
        current = cell_current_a(pack_current, pack)
        heat = mean_cell_heat_w(
            ca.dot(shares, current),
            ca.dot(shares, current * current),
            cell_resistance_ohm(at, losses_before, cell),
            at,
            cell,
        )
        loop = coolant_loop(at)
        # The coolant is linear in the cooling rate, and so may be averaged over the instants.
        coolant = channel.coolant_k(ca.dot(shares, loop.inlet_k), at)[:-1]
        taken = heat + heat_from_air_w(at, parameters)
        rates = cell_temperature_rate_k_s(taken, at, ca.vertcat(*coolant), cell, cooling)
        return pack_current, heat, rates, ca.dot(shares, loop.cooling_rate_w)

    middle = before + 0.5 * length * means(before)[2]
    currents, heat, rates, cooling_rate = means(middle)
    # The aging rate is not linear in the current: every cell at the middle of every sub-step.
    lost = sum(
        lengths[step]
        * capacity_loss_rate_1_s(
            cell_current_a(currents[3 * step + 1], pack),
            middle,
            losses_before,
            parameters.aging,
            cell,
        )
        for step in range(n)
    )
    temperatures, losses = before + length * rates, losses_before + lost
    current = pack_currents(temperatures, losses, battery[-1])
    loop = coolant_loop(temperatures)
    voltages = cell_voltage_v(cell_current_a(current, pack), temperatures, losses, parameters)
    results = {
        "temperatures_k": temperatures,
        "capacity_losses": losses,
        "traction_energy_j": ca.dot(weights, traction),
        "regenerated_energy_j": ca.dot(weights, traction - maximum(traction, 0.0)),
        "battery_energy_j": ca.dot(weights, battery),
        "chiller_heat_j": length * cooling_rate,
        "battery_heat_j": length * mean_of(heat) * pack.cells,
        "charge_c": ca.dot(weights, deliverable(currents, battery, bounds)),
        "pack_current_a": current,
        "cell_current_a": cell_current_a(current, pack),
        "coolant_inlet_k": loop.inlet_k[-1],
        "coolant_outlet_k": loop.outlet_k[-1],
        "cell_1_voltage_v": voltages[0],
        "cell_n_voltage_v": voltages[-1],
        "pack_voltage_v": mean_of(voltages) * pack.cells_in_series,
    }
    cells = {"start_temperatures_k": before, "start_capacity_losses": losses_before}
    return named_function("channel_step", cells | given, results, cse=True)

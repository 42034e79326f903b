"""Integration of the exact model over one interval of prescribed motion.

Classical Runge-Kutta of order four on the four cell states; energies, heat and charge are quadratures of
the same stages. What depends on the state of charge is that of the start of the interval. The sub-steps are
unrolled once into a compiled expression graph of the very functions that the rest of the project uses, and
evaluated on a fixed pair of buffers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_heat_w, cell_resistance_ohm
from iptm_core.physics.charge import at_charge
from iptm_core.physics.coolant import reduce_channel
from iptm_core.physics.ops import Scalar, maximum
from iptm_core.physics.power_thermal import CellPair, PowerThermalRates, power_thermal_rates
from iptm_core.state import ChannelCells, FloatArray
from iptm_plant_sim.motion import Motion

_CELLS = 4


@dataclass(frozen=True)
class IntervalResult:
    """Cell states and electrics at the end of an interval, and energies over it.

    Attributes:
        cells: temperatures (K) and capacity losses of cell 1 and cell N_c at the end.
        traction_energy_j: electric traction energy, regeneration counted negative.
        regenerated_energy_j: its negative part, before the regenerative efficiency.
        battery_energy_j: energy at the terminals, positive when discharging.
        chiller_heat_j: heat taken from the coolant.
        battery_heat_j: heat generated in all cells, ohmic and entropic.
        charge_c: charge drawn from the pack.
        pack_current_a: pack current at the end, positive when discharging.
        cell_current_a: cell current at the end.
        coolant_inlet_k: channel inlet temperature at the end.
        coolant_outlet_k: channel outlet temperature at the end.
        cell_1_voltage_v: terminal voltage of cell 1 at the end.
        cell_n_voltage_v: terminal voltage of cell N_c at the end.
        pack_voltage_v: terminal voltage of the pack at the end.
        channel: all cells of a channel at the end; None where only two are integrated.
    """

    cells: CellPair
    traction_energy_j: float
    regenerated_energy_j: float
    battery_energy_j: float
    chiller_heat_j: float
    battery_heat_j: float
    charge_c: float
    pack_current_a: float
    cell_current_a: float
    coolant_inlet_k: float
    coolant_outlet_k: float
    cell_1_voltage_v: float
    cell_n_voltage_v: float
    pack_voltage_v: float
    channel: ChannelCells | None = None

    @property
    def finite(self) -> bool:
        """False if the pack could not deliver the power asked for at some stage."""
        return bool(np.isfinite(self.battery_energy_j + self.charge_c + self.pack_current_a))


class PackedFunction:
    """A CasADi function of one vector to one vector, on memory of its own.

    Attributes:
        arguments: write the values of the next call into it.
    """

    def __init__(self, function: ca.Function) -> None:
        self.arguments = np.zeros(function.size1_in(0))
        self._results = np.zeros(function.size1_out(0))
        # CasADi's stubs lack the overload for a memoryview, which carries its own size.
        buffer: Any
        buffer, self._evaluate = function.buffer()
        buffer.set_arg(0, self.arguments.data)
        buffer.set_res(0, self._results.data)
        self._buffer = buffer

    def __call__(self) -> FloatArray:
        """Evaluate; the next call overwrites what is returned."""
        self._evaluate()
        return self._results


class IntervalIntegrator:
    """Integrates intervals of a fixed number of sub-steps for one parameter set."""

    def __init__(self, parameters: ModelParameters, sub_steps: int) -> None:
        """Build the expression graph.

        Args:
            parameters: the model parameters.
            sub_steps: number of Runge-Kutta steps n per interval.
        """
        self._n = sub_steps
        self._function = PackedFunction(_build(parameters, sub_steps))

    def integrate(
        self,
        cells: CellPair,
        compressor_power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        charge: float = math.nan,
    ) -> IntervalResult:
        """Integrate one interval.

        Args:
            cells: cell states at the start.
            compressor_power_w: compressor power, held over the interval.
            motion: the motion, laid out for the same number of sub-steps.
            slopes_rad: slope at ``motion.positions_m``, shape (2 n + 1,).
            charge: state of charge at the start; NaN where nothing depends on it.
        """
        n, x = self._n, self._function.arguments
        x[0] = cells.cell_1_temperature_k
        x[1] = cells.cell_n_temperature_k
        x[2] = cells.cell_1_capacity_loss
        x[3] = cells.cell_n_capacity_loss
        x[4] = compressor_power_w
        x[5 : 5 + n] = motion.lengths_s
        x[5 + n : 5 + 2 * n] = motion.accelerations_m_s2
        x[5 + 2 * n : 6 + 4 * n] = slopes_rad
        x[6 + 4 * n : 6 + 7 * n] = motion.speeds_m_s.ravel()
        x[6 + 7 * n] = charge
        values = self._function().tolist()
        return IntervalResult(CellPair(*values[:_CELLS]), *values[_CELLS:])


@lru_cache(maxsize=16)
def _build(parameters: ModelParameters, n: int) -> ca.Function:
    """One function from the packed arguments of ``integrate`` to the packed ``IntervalResult``.

    Kept for the next vehicle with the same parameters, because building takes much longer than a step.
    """
    channel = reduce_channel(parameters.cooling, parameters.pack)
    arguments = ca.SX.sym("arguments", 7 + 7 * n)
    parameters = at_charge(parameters, arguments[6 + 7 * n])
    state = [arguments[i] for i in range(_CELLS)]
    compressor = arguments[4]
    lengths = arguments[5 : 5 + n]
    accelerations = arguments[5 + n : 5 + 2 * n]
    slopes = arguments[5 + 2 * n : 6 + 4 * n]
    speeds = arguments[6 + 4 * n : 6 + 7 * n]

    def rates_at(step: int, stage: int, cells: list[Scalar]) -> PowerThermalRates:
        return power_thermal_rates(
            speeds[3 * step + stage],
            accelerations[step],
            slopes[2 * step + stage],
            compressor,
            CellPair(*cells),
            parameters,
            channel,
        )

    def derivatives(step: int, stage: int, cells: list[Scalar]) -> list[Scalar]:
        rates = rates_at(step, stage, cells)
        return [
            rates.cell_1_temperature_rate_k_s,
            rates.cell_n_temperature_rate_k_s,
            rates.cell_1_capacity_loss_rate_1_s,
            rates.cell_n_capacity_loss_rate_1_s,
            rates.traction_power_w,
            rates.traction_power_w - maximum(rates.traction_power_w, 0.0),
            rates.battery_power_w,
            rates.coolant.cooling_rate_w,
            _pack_heat_w(rates.cell_current_a, cells, parameters),
            rates.pack_current_a,
        ]

    quadratures: list[Scalar] = [ca.SX(0.0)] * 6
    for step in range(n):
        h = lengths[step]

        def moved(slope: list[Scalar], by: Scalar, origin: list[Scalar] = state) -> list[Scalar]:
            return [value + by * rate for value, rate in zip(origin, slope, strict=False)]

        k1 = derivatives(step, 0, state)
        k2 = derivatives(step, 1, moved(k1, 0.5 * h))
        k3 = derivatives(step, 1, moved(k2, 0.5 * h))
        k4 = derivatives(step, 2, moved(k3, h))
        mean = [(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
        state = moved(mean, h)
        quadratures = [
            value + h * rate for value, rate in zip(quadratures, mean[_CELLS:], strict=True)
        ]

    end = rates_at(n - 1, 2, state)
    voltage_1, voltage_n = (
        cell_voltage_v(end.cell_current_a, state[i], state[2 + i], parameters) for i in (0, 1)
    )
    outputs = [
        *state,
        *quadratures,
        end.pack_current_a,
        end.cell_current_a,
        end.coolant.inlet_k,
        end.coolant.outlet_k,
        voltage_1,
        voltage_n,
        0.5 * (voltage_1 + voltage_n) * parameters.pack.cells_in_series,
    ]
    return ca.Function("interval", [arguments], [ca.vertcat(*outputs)], {"cse": True})


def _pack_heat_w(current_a: Scalar, cells: list[Scalar], parameters: ModelParameters) -> Scalar:
    """Heat of all cells, taken as evenly spread between the two modelled ones."""
    cell, pack = parameters.cell, parameters.pack
    heat_1 = cell_heat_w(current_a, cell_resistance_ohm(cells[0], cells[2], cell), cells[0], cell)
    heat_n = cell_heat_w(current_a, cell_resistance_ohm(cells[1], cells[3], cell), cells[1], cell)
    return 0.5 * (heat_1 + heat_n) * (pack.cells_in_series * pack.parallel)


def cell_voltage_v(
    current_a: Scalar, temperature_k: Scalar, capacity_loss: Scalar, parameters: ModelParameters
) -> Scalar:
    """Terminal voltage of one cell in the sense of eq. (7): source less entropic and ohmic part.

    The parameters are those at a state of charge, see ``at_charge``.
    """
    cell = parameters.cell
    source = parameters.pack.open_circuit_voltage_v / parameters.pack.cells_in_series
    resistance = cell_resistance_ohm(temperature_k, capacity_loss, cell)
    return source - cell.entropic_coefficient_v_k * temperature_k - resistance * current_a

"""Cooling from the paper's printed numbers alone: its payback time, and the effect of braking.

Nothing here is identified. The ratio of both cells' degradations under the reference gives, by the printed
aging law, how much warmer cell N is; the coolant warms up by as much along the channel, which is the heat
that it carries; with the printed cooling energy that is a coefficient of performance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_controller.strategy import strategy_by_name
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_reproduction import figures as fig
from iptm_reproduction.printed import LARGEST_VICE_RATIO_J, STRATEGY_VALUES
from iptm_reproduction.runs import REFERENCE, STRATEGIES
from iptm_studies.run_spec import REPRODUCED_SET

TRIP_S = 1e4
"""Duration of the paper's driving cycle (Section IV-A)."""
HORIZON_S = 15.0
"""Single horizon of the comparison of strategies (Section IV-B)."""
_TEMPERATURE_STEP_K = 0.1
_CURRENT_STEP_A = 1e-3


@dataclass(frozen=True)
class PrintedCooling:
    """Figures of the printed reference.

    Attributes:
        cells_differ_k: mean temperature of cell N above cell 1.
        heat_w: mean heat that the coolant carries.
        compressor_power_w: mean of P_cp.
        cop: heat per compressor energy.
        pays_after_s: time after which slower aging has made up for the current that cooling draws; a lower
            bound, because the cells are taken to stay as cool.
        braking_refund: what the aging term of the vice benchmark gives back of a joule that its energy
            term charges, where the compressor takes it from a charging current: at the mean C-rate, cells
            at their upper limit, and the largest printed ratio of the weights.
    """

    cells_differ_k: float
    heat_w: float
    compressor_power_w: float
    cop: float
    pays_after_s: float
    braking_refund: float

    def cop_to_pay_within(self, horizon_s: float) -> float:
        """Return the coefficient of performance with which cooling would pay after a time."""
        return self.cop * self.pays_after_s / horizon_s


def printed_cooling(parameters: ModelParameters, reference_k: float) -> PrintedCooling:
    """Work the figures out.

    Args:
        parameters: Tables I and II, and the cells of a channel that follow from them.
        reference_k: temperature that the reference keeps (r_T).
    """
    pack, cooling, cell = parameters.pack, parameters.cooling, parameters.cell
    row = STRATEGIES.index(REFERENCE)
    cooling_kj, total_kj, loss_1, loss_n = (
        STRATEGY_VALUES[figure][row] for figure in (fig.COOLING, fig.TOTAL, fig.CELL_1, fig.CELL_N)
    )
    power_w = 1e3 * total_kj / TRIP_S
    current_a = power_w / (pack.open_circuit_voltage_v * pack.parallel)

    def log_rate(current: float, temperature_k: float) -> float:
        loss = parameters.aging.initial_capacity_loss
        return math.log(
            capacity_loss_rate_1_s(current, temperature_k, loss, parameters.aging, cell)
        )

    def per_ampere(temperature_k: float) -> float:
        step = log_rate(current_a + _CURRENT_STEP_A, temperature_k)
        return (step - log_rate(current_a, temperature_k)) / _CURRENT_STEP_A

    warmer = log_rate(current_a, reference_k + _TEMPERATURE_STEP_K)
    per_kelvin = (warmer - log_rate(current_a, reference_k)) / _TEMPERATURE_STEP_K
    cells_differ_k = math.log(loss_n / loss_1) / per_kelvin
    heat_w = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k * cells_differ_k
    compressor_power_w = 1e3 * cooling_kj / TRIP_S - cooling.auxiliary_power_w
    cop = heat_w / compressor_power_w
    per_watt = 1.0 / (pack.open_circuit_voltage_v * pack.parallel)
    heat_capacity_j_k = pack.modules * pack.cells_per_channel * cell.heat_capacity_j_k
    limit_k = parameters.limits.max_temperature_k
    both_cells_1_s = 2.0 * math.exp(log_rate(current_a, limit_k))
    return PrintedCooling(
        cells_differ_k=cells_differ_k,
        heat_w=heat_w,
        compressor_power_w=compressor_power_w,
        cop=cop,
        pays_after_s=heat_capacity_j_k * per_ampere(reference_k) * per_watt / (cop * per_kelvin),
        braking_refund=LARGEST_VICE_RATIO_J * both_cells_1_s * per_ampere(limit_k) * per_watt,
    )


def reproduced_cooling() -> PrintedCooling:
    """Return the figures with the printed parameters and the printed reference temperature."""
    reference_k = strategy_by_name("reference").reference_temperature_k
    return printed_cooling(load_parameters(REPRODUCED_SET).values, reference_k)

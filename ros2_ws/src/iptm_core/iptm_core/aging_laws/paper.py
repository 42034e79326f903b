"""The paper's law, eqs. (11) and (12), behind the common interface: throughput only, nothing at rest."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.aging_laws.law import AgingLaw, Load, Mechanism
from iptm_core.parameters.model import AgingParameters, CellParameters, ModelParameters
from iptm_core.physics.aging import capacity_loss_rate_1_s
from iptm_core.physics.ops import Scalar, absolute


@dataclass(frozen=True)
class ThroughputAging:
    """Loss over throughput, eq. (11); ``physics.aging.capacity_loss_rate_1_s`` is its equation.

    Attributes:
        aging: coefficients.
        cell: nominal capacity.
    """

    aging: AgingParameters
    cell: CellParameters

    @property
    def mechanism(self) -> Mechanism:
        """Cyclic."""
        return Mechanism.CYCLIC

    @property
    def exponent(self) -> float:
        """Exponent z of the throughput."""
        return self.aging.throughput_exponent

    def loss_rate_1_s(self, load: Load, capacity_loss: Scalar) -> Scalar:
        """Return eq. (12) divided by the time step, at a capacity loss."""
        current_a = load.c_rate_1_h * self.cell.nominal_capacity_ah
        return capacity_loss_rate_1_s(
            current_a, load.temperature_k, capacity_loss, self.aging, self.cell
        )

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^(1/z)."""
        return self.loss_rate_1_s(load, 1.0) / self.exponent

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        c_rate_1_h = absolute(load.c_rate_1_h)
        energy = (
            self.aging.activation_energy_j_mol - self.aging.compensation_factor_j_mol * c_rate_1_h
        )
        gas = self.aging.gas_constant_j_mol_k * self.exponent
        return self.damage_rate_1_s(load) * energy / (gas * load.temperature_k**2)


def paper_law(parameters: ModelParameters) -> AgingLaw:
    """Return the law of a parameter set, as the plant and the controller have it."""
    return AgingLaw("paper", (ThroughputAging(parameters.aging, parameters.cell),))

"""What every ageing law answers: rates of damage, their slope over temperature, and capacity loss.

A mechanism that loses ``k x^p`` of capacity after a time or throughput x under a constant load has the
age-free damage ``u = Q^(1/p)``, whose rate ``du/dt = k^(1/p) dx/dt`` depends on the load only. Damage of
loads in any order adds up, and the loss is the sum of ``u^p`` over the mechanisms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from iptm_core.declaration import TextEnum
from iptm_core.parameters.model import AgingParameters, CellParameters, ModelParameters
from iptm_core.physics.cell import aging_current_a, capacity_loss_rate_1_s
from iptm_core.physics.ops import Scalar, absolute


class Mechanism(TextEnum):
    """What a part of the capacity is lost to."""

    CALENDAR = "calendar"
    CYCLIC = "cyclic"


@dataclass(frozen=True)
class Load:
    """What a cell is exposed to; floats, arrays that broadcast, or symbols.

    Attributes:
        c_rate_1_h: current over nominal capacity, positive when discharging.
        charge: state of charge, 0 to 1.
        depth: depth of discharge of the cycle that this instant belongs to, 0 to 1.
        mean_c_rate_1_h: magnitude of the C-rate averaged over that cycle, rest included.
        charging_c_rate_1_h: C-rate averaged over the charging of that cycle.
    """

    temperature_k: Scalar
    c_rate_1_h: Scalar = 0.0
    charge: Scalar = 0.5
    depth: Scalar = 0.0
    mean_c_rate_1_h: Scalar = 0.0
    charging_c_rate_1_h: Scalar = 0.0


class MechanismLaw(Protocol):
    """One mechanism of a law; ``exponent`` is the p of its loss over time or throughput."""

    @property
    def mechanism(self) -> Mechanism: ...  # noqa: D102

    @property
    def exponent(self) -> float: ...  # noqa: D102

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of the age-free damage u, not negative."""
        ...

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        ...


@dataclass(frozen=True)
class AgingLaw:
    """Capacity loss of a cell as the sum of its mechanisms; damage is given in their order."""

    name: str
    mechanisms: tuple[MechanismLaw, ...]

    def capacity_loss(self, damage: Sequence[Scalar]) -> Scalar:
        """Return the loss as a share of nominal capacity."""
        return sum(u**law.exponent for u, law in zip(damage, self.mechanisms, strict=True))

    def loss_rate_1_s(self, load: Load, damage: Sequence[Scalar]) -> Scalar:
        """Return the rate of capacity loss at a damage, positive where its exponent is below 1."""
        return sum(
            law.exponent * u ** (law.exponent - 1.0) * law.damage_rate_1_s(load)
            for u, law in zip(damage, self.mechanisms, strict=True)
        )

    def loss_slope_1_s_k(self, load: Load, damage: Sequence[Scalar]) -> Scalar:
        """Return the derivative of ``loss_rate_1_s`` with respect to temperature."""
        return sum(
            law.exponent * u ** (law.exponent - 1.0) * law.damage_slope_1_s_k(load)
            for u, law in zip(damage, self.mechanisms, strict=True)
        )


@dataclass(frozen=True)
class ThroughputAging:
    """Loss over throughput, eq. (11); ``capacity_loss_rate_1_s`` is its equation."""

    mechanism: ClassVar = Mechanism.CYCLIC
    aging: AgingParameters
    cell: CellParameters

    @property
    def exponent(self) -> float:
        """Exponent z of the throughput."""
        return self.aging.throughput_exponent

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^(1/z): eq. (12) at a loss of 1, divided by time step and z."""
        current_a = load.c_rate_1_h * self.cell.nominal_capacity_ah
        rate = capacity_loss_rate_1_s(current_a, load.temperature_k, 1.0, self.aging, self.cell)
        return rate / self.exponent

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        c_rate_1_h = aging_current_a(load.c_rate_1_h, absolute(load.c_rate_1_h), self.aging)
        energy = (
            self.aging.activation_energy_j_mol - self.aging.compensation_factor_j_mol * c_rate_1_h
        )
        gas = self.aging.gas_constant_j_mol_k * self.exponent
        return self.damage_rate_1_s(load) * energy / (gas * load.temperature_k**2)


def paper_law(parameters: ModelParameters) -> AgingLaw:
    """Return the law of a parameter set, as the plant and the controller have it."""
    return AgingLaw("paper", (ThroughputAging(parameters.aging, parameters.cell),))

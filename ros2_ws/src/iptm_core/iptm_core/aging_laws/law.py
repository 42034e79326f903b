"""What every ageing law answers: rates of damage, their slope over temperature, and capacity loss.

A mechanism that loses ``k x^p`` of capacity after a time or throughput x under a constant load has the
age-free damage ``u = Q^(1/p)``, whose rate ``du/dt = k^(1/p) dx/dt`` depends on the load only. Damage of
loads in any order adds up, and the loss is the sum of ``u^p`` over the mechanisms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from iptm_core.declaration import TextEnum
from iptm_core.parameters.model import AgingParameters, CellParameters, ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_core.physics.ops import Scalar, absolute

SECONDS_PER_DAY = 86400.0
SECONDS_PER_HOUR = 3600.0


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
    """One mechanism of a law.

    Attributes:
        exponent: p of the loss over time or throughput.
    """

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
    """Capacity loss of a cell as the sum of its mechanisms.

    Attributes:
        mechanisms: mechanisms; damage is given in their order.
    """

    name: str
    mechanisms: tuple[MechanismLaw, ...]

    def capacity_loss(self, damage: Sequence[Scalar]) -> Scalar:
        """Return the loss as a share of nominal capacity."""
        return sum(u**law.exponent for u, law in zip(damage, self.mechanisms, strict=True))

    def loss_rate_1_s(self, load: Load, damage: Sequence[Scalar]) -> Scalar:
        """Return the rate of capacity loss at an age.

        Args:
            damage: present damage of each mechanism, positive where its exponent is below 1.
        """
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
class AgingState:
    """Age of a cell, with what sequence-dependent laws remember of the present day.

    Cycles are days: depth and mean C-rate of a day become known at its end, and the next day ages by them.

    Attributes:
        damage: damage of each mechanism of the law.
        day_s: time since the present day began.
        throughput_c_s: integral of the magnitude of the C-rate over that day, in s/h.
        depth: depth of discharge of the last complete day.
        mean_c_rate_1_h: mean magnitude of the C-rate of the last complete day.
        charged_c_s: integral of the C-rate while charging over the present day, in s/h.
        charging_c_rate_1_h: mean C-rate while charging of the last complete day.
    """

    damage: tuple[float, ...]
    day_s: float = 0.0
    lowest_charge: float = 1.0
    highest_charge: float = 0.0
    throughput_c_s: float = 0.0
    depth: float = 0.0
    mean_c_rate_1_h: float = 0.0
    charged_c_s: float = 0.0
    charging_s: float = 0.0
    charging_c_rate_1_h: float = 0.0


def new_cell(law: AgingLaw) -> AgingState:
    """Return the state of a cell without age."""
    return AgingState((0.0,) * len(law.mechanisms))


def aged(
    law: AgingLaw,
    state: AgingState,
    duration_s: float,
    temperature_k: float,
    c_rate_1_h: float,
    charge: float,
) -> AgingState:
    """Return the state after an interval of constant load, shorter than a day."""
    load = Load(
        temperature_k,
        c_rate_1_h,
        charge,
        state.depth,
        state.mean_c_rate_1_h,
        state.charging_c_rate_1_h,
    )
    grown = tuple(
        u + duration_s * float(one.damage_rate_1_s(load))
        for u, one in zip(state.damage, law.mechanisms, strict=True)
    )
    after = replace(
        state,
        damage=grown,
        day_s=state.day_s + duration_s,
        lowest_charge=min(state.lowest_charge, charge),
        highest_charge=max(state.highest_charge, charge),
        throughput_c_s=state.throughput_c_s + duration_s * float(absolute(c_rate_1_h)),
        charged_c_s=state.charged_c_s - duration_s * min(c_rate_1_h, 0.0),
        charging_s=state.charging_s + (duration_s if c_rate_1_h < 0.0 else 0.0),
    )
    if after.day_s < SECONDS_PER_DAY:
        return after
    return AgingState(
        grown,
        depth=after.highest_charge - after.lowest_charge,
        mean_c_rate_1_h=after.throughput_c_s / after.day_s,
        charging_c_rate_1_h=after.charged_c_s / after.charging_s if after.charging_s else 0.0,
    )


@dataclass(frozen=True)
class ThroughputAging:
    """Loss over throughput, eq. (11); ``physics.aging.capacity_loss_rate_1_s`` is its equation."""

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

"""Ageing laws: rates of damage, their slope over temperature, capacity loss, and semi-empirical mechanisms.

A mechanism that loses ``k x^p`` of capacity after a time or throughput x under a constant load has the
age-free damage ``u = Q^(1/p)``, whose rate ``du/dt = k^(1/p) dx/dt`` depends on the load only. Damage of
loads in any order adds up, and the loss is the sum of ``u^p`` over the mechanisms.

Calendar: ``Q = k t^p``, t in days. Cyclic: ``Q = k n^p``, n in equivalent full cycles, two nominal
capacities of throughput each. The coefficients k of all forms are of the kind ``exp(f(T, load))``, with the
Arrhenius term and the state of charge or the anode potential.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from iptm_core.declaration import TextEnum
from iptm_core.parameters.model import AgingParameters, CellParameters, ModelParameters
from iptm_core.physics.cell import ChargeTable, aging_current_a, capacity_loss_rate_1_s
from iptm_core.physics.ops import Scalar, absolute, exp, maximum, sqrt, where
from iptm_core.units import SECONDS_PER_DAY, SECONDS_PER_HOUR


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


_CHARGES_PER_CYCLE = 2.0


def tanh(value: Scalar) -> Scalar:
    """Hyperbolic tangent."""
    return 1.0 - 2.0 / (exp(2.0 * value) + 1.0)


def anode_potential_v(charge: Scalar) -> Scalar:
    """Potential of a graphite anode against lithium.

    Args:
        charge: state of charge, 0 to 1. The anode is lithiated from 0.0085 to 0.78 (Schimpe et al., J.
            Electrochem. Soc. 165, 2018, A181, doi:10.1149/2.1181714jes).

    Returns:
        Potential in V (Safari and Delacourt, J. Electrochem. Soc. 158, 2011, A562, doi:10.1149/1.3567007).
    """
    lithiation = 0.0085 + charge * (0.78 - 0.0085)
    steps = (
        (0.044, 0.1958, 0.1088),
        (0.1978, 1.0571, 0.0854),
        (0.6875, -0.0117, 0.0529),
        (0.0175, 0.5692, 0.0875),
    )
    potential = 0.6379 + 0.5416 * exp(-305.5309 * lithiation)
    for height, centre, width in steps:
        potential = potential - height * tanh((lithiation - centre) / width)
    return potential


@dataclass(frozen=True)
class CalendarAging:
    """Loss over time, ``k = factor * exp(-activation / T + slope * stress(SOC) / T)``.

    With the anode potential as stress and a negative slope this is the Tafel form of a side reaction at the
    anode; ``scale`` multiplies k by a function of the state of charge.

    Attributes:
        factor: pre-exponential factor, 1/day^p.
        activation_k: activation energy over gas constant.
        slope_k: coefficient of the stress.
        stress: state of charge to stress, without unit or in V.
        scale: state of charge to a factor of k; None for 1.
    """

    mechanism: ClassVar = Mechanism.CALENDAR
    factor: float
    activation_k: float
    slope_k: float
    exponent: float
    stress: Callable[[Scalar], Scalar]
    scale: ChargeTable | None = None

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^(1/p)."""
        temperature_k, stress = load.temperature_k, self.stress(load.charge)
        k = self.factor * exp((self.slope_k * stress - self.activation_k) / temperature_k)
        if self.scale is not None:
            k = k * self.scale.at(load.charge)
        return k ** (1.0 / self.exponent) / SECONDS_PER_DAY

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        energy_k = self.activation_k - self.slope_k * self.stress(load.charge)
        return self.damage_rate_1_s(load) * energy_k / (self.exponent * load.temperature_k**2)


def cycles_1_s(load: Load) -> Scalar:
    """Return the rate of equivalent full cycles."""
    return absolute(load.c_rate_1_h) / (_CHARGES_PER_CYCLE * SECONDS_PER_HOUR)


@dataclass(frozen=True)
class CyclicAging:
    """Loss over throughput, ``k = intensity(load) * (exp(a_1 / T) + exp(a_2 / T))``.

    Attributes:
        intensity: what depth, state of charge and mean C-rate make of k, before temperature.
        exponents_k: a_1 and a_2; one alone leaves the other term out, with none k does not depend on T.
    """

    mechanism: ClassVar = Mechanism.CYCLIC
    intensity: Callable[[Load], Scalar]
    exponents_k: tuple[float, ...]
    exponent: float

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^(1/p)."""
        k = self.intensity(load)
        if self.exponents_k:
            k = k * sum(exp(a / load.temperature_k) for a in self.exponents_k)
        return k ** (1.0 / self.exponent) * cycles_1_s(load)

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        if not self.exponents_k:
            return 0.0 * load.temperature_k
        terms = [exp(a / load.temperature_k) for a in self.exponents_k]
        slope = -sum(a * term for a, term in zip(self.exponents_k, terms, strict=True)) / sum(terms)
        return self.damage_rate_1_s(load) * slope / (self.exponent * load.temperature_k**2)


def linear_intensity(constant: float, rate: float, depth: float, load: Load) -> Scalar:
    """Return ``constant + rate * mean C-rate + depth * depth``."""
    return constant + rate * load.mean_c_rate_1_h + depth * load.depth


def depth_intensity(factor: float, gain: float, load: Load) -> Scalar:
    """Return ``factor * exp(gain * exp(depth^2))`` (Smith et al. 2017)."""
    return factor * exp(gain * exp(load.depth * load.depth))


def voltage_intensity(
    curvature_1_v2: float,
    best_v: float,
    constant: float,
    depth: float,
    voltage: ChargeTable,
    unit: float,
    load: Load,
) -> Scalar:
    """Return ``unit * (curvature * (V - best)^2 + constant + depth * depth)`` (Schmalstieg et al. 2014).

    Args:
        unit: from the published unit of throughput to equivalent full cycles.
    """
    off_v = voltage.at(load.charge) - best_v
    return unit * (curvature_1_v2 * off_v * off_v + constant + depth * load.depth)


_GAS_J_MOL_K = 8.3144
_REFERENCE_K = 298.15
_POLYNOMIAL = (-0.000197, 0.0101, -0.0157, 0.00835)
_PER_K = -4.06e-6
_HOT_K, _PER_HOT_K = 328.15, 3.32e-5
_FILM_J_MOL, _RATE_J_MOL, _DEPTH_J_MOL = 37000.0, -58000.0, -13000.0
_RATE, _RATE_PER_CHARGE, _RATE_FREE = 3.24, 2.1, 0.099
_DEPTH, _DEPTH_POWER = 1.44, 6
_COUPLING = 0.985


def _arrhenius(temperature_k: Scalar, energy_j_mol: float) -> Scalar:
    return exp(energy_j_mol / _GAS_J_MOL_K * (1.0 / _REFERENCE_K - 1.0 / temperature_k))


def _energy_slope_1_k(temperature_k: Scalar, energy_j_mol: float) -> Scalar:
    """Return the derivative of the logarithm of that over temperature."""
    return energy_j_mol / (_GAS_J_MOL_K * temperature_k * temperature_k)


def _film(load: Load) -> tuple[Scalar, Scalar]:
    """Return b_t in 1/sqrt(day), not negative, and its derivative over temperature."""
    kelvin, charge = load.temperature_k, load.charge
    constant, first, second, third = _POLYNOMIAL
    share = constant + charge * (first + charge * (second + charge * third))
    share = share + _PER_K * charge * kelvin + _PER_HOT_K * maximum(kelvin - _HOT_K, 0.0)
    share_1_k = _PER_K * charge + where(kelvin > _HOT_K, _PER_HOT_K, 0.0)
    arrhenius = _arrhenius(kelvin, _FILM_J_MOL)
    grown = maximum(share, 0.0)
    slope = grown * _energy_slope_1_k(kelvin, _FILM_J_MOL) + where(share > 0.0, share_1_k, 0.0)
    return arrhenius * grown, arrhenius * slope


def _cracking(load: Load) -> tuple[Scalar, Scalar]:
    """Return b_N, not negative, and its derivative over temperature."""
    kelvin = load.temperature_k
    rate = (
        _RATE
        * sqrt(load.depth * load.charging_c_rate_1_h)
        * (1.0 + _RATE_PER_CHARGE * load.charge)
        * _arrhenius(kelvin, _RATE_J_MOL)
    )
    depth = _DEPTH * load.depth**_DEPTH_POWER * _arrhenius(kelvin, _DEPTH_J_MOL)
    slope = where(rate > _RATE_FREE, rate, 0.0) * _energy_slope_1_k(kelvin, _RATE_J_MOL)
    slope = slope + depth * _energy_slope_1_k(kelvin, _DEPTH_J_MOL)
    return maximum(rate - _RATE_FREE, 0.0) + depth, slope


@dataclass(frozen=True)
class FilmGrowth:
    """Calendar part; the exponent of time is a half."""

    mechanism: ClassVar = Mechanism.CALENDAR
    exponent: float = 0.5

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^2."""
        film, _ = _film(load)
        return film * film / SECONDS_PER_DAY

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        film, slope = _film(load)
        return 2.0 * film * slope / SECONDS_PER_DAY


@dataclass(frozen=True)
class CrackedFilmGrowth:
    """Cyclic part; the exponent of the throughput is a half."""

    mechanism: ClassVar = Mechanism.CYCLIC
    exponent: float = 0.5

    def damage_rate_1_s(self, load: Load) -> Scalar:
        """Return the rate of u = Q^2."""
        k = _COUPLING * _film(load)[0] * _cracking(load)[0]
        return k * k * cycles_1_s(load)

    def damage_slope_1_s_k(self, load: Load) -> Scalar:
        """Return the derivative of that rate with respect to temperature."""
        film, film_1_k = _film(load)
        cracking, cracking_1_k = _cracking(load)
        k, slope = film * cracking, film * cracking_1_k + film_1_k * cracking
        return 2.0 * _COUPLING**2 * k * slope * cycles_1_s(load)

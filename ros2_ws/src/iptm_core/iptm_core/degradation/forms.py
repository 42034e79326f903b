"""Published forms of ageing mechanisms; their numbers stand in ``cells.py``.

Rates of calendar mechanisms were fitted per day, those of cyclic ones per equivalent full cycle (two times the
nominal capacity of throughput).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.degradation.law import Cause, CellUse
from iptm_core.parameters.model import AgingParameters, CellParameters
from iptm_core.physics.aging import SECONDS_PER_HOUR
from iptm_core.state import FloatArray

SECONDS_PER_DAY = 86400.0
GAS_CONSTANT_J_MOL_K = 8.3144
REFERENCE_K = 298.15


def graphite_potential_v(state_of_charge: FloatArray) -> FloatArray:
    """Return the open-circuit potential of a graphite electrode against lithium in V.

    M. Safari, C. Delacourt, J. Electrochem. Soc. 158 (2011) A562, with the lithiation going from 0.0085 in the
    empty to 0.78 in the full cell.

    Args:
        state_of_charge: of the cell, from 0 to 1.
    """
    x = 0.0085 + state_of_charge * (0.78 - 0.0085)
    potential: FloatArray = (
        0.6379
        + 0.5416 * np.exp(-305.5309 * x)
        + 0.044 * np.tanh(-(x - 0.1958) / 0.1088)
        - 0.1978 * np.tanh((x - 1.0571) / 0.0854)
        - 0.6875 * np.tanh((x + 0.0117) / 0.0529)
        - 0.0175 * np.tanh((x - 0.5692) / 0.0875)
    )
    return potential


def _cycles_1_s(use: CellUse) -> FloatArray:
    """Return equivalent full cycles per second."""
    return use.c_rate_1_h / (2.0 * SECONDS_PER_HOUR)


def arrhenius(temperature_k: FloatArray, energy_j_mol: float) -> FloatArray:
    """Return the Arrhenius factor relative to 25 degC."""
    factor: FloatArray = np.exp(
        -energy_j_mol / GAS_CONSTANT_J_MOL_K * (1.0 / temperature_k - 1.0 / REFERENCE_K)
    )
    return factor


@dataclass(frozen=True)
class ArrheniusTafel:
    """Calendar ageing: ``k = A exp(B/T) exp(C x/T)`` per day^p.

    Attributes:
        factor: A.
        temperature_k: B, negative: the activation energy by the gas constant.
        tafel_k: C, in K, or in K/V where x is a potential.
        exponent: p.
        potential: whether x is the potential of the graphite electrode; else it is the state of charge.
    """

    factor: float
    temperature_k: float
    tafel_k: float
    exponent: float
    potential: bool = False
    cause: Cause = Cause.CALENDAR

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s."""
        x = graphite_potential_v(use.state_of_charge) if self.potential else use.state_of_charge
        k = self.factor * np.exp((self.temperature_k + self.tafel_k * x) / use.temperature_k)
        rate: FloatArray = k ** (1.0 / self.exponent) / SECONDS_PER_DAY
        return rate


@dataclass(frozen=True)
class ThroughputBowl:
    """Cyclic ageing, least at medium temperatures: ``k = (a + b c + d DOD) (exp(e/T) + exp(-f/T))``.

    Attributes:
        constant: a.
        per_c_rate: b.
        per_depth: d.
        cold_k: e.
        hot_k: f.
        exponent: p.
    """

    constant: float
    per_c_rate: float
    per_depth: float
    cold_k: float
    hot_k: float
    exponent: float
    cause: Cause = Cause.CYCLIC

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s."""
        stress = (
            self.constant
            + self.per_c_rate * use.c_rate_1_h
            + self.per_depth * use.depth_of_discharge
        )
        t = use.temperature_k
        k = stress * (np.exp(self.cold_k / t) + np.exp(-self.hot_k / t))
        rate: FloatArray = k ** (1.0 / self.exponent) * _cycles_1_s(use)
        return rate


@dataclass(frozen=True)
class ThroughputDepth:
    """Cyclic ageing: ``k = A exp(B/T) exp(C exp(DOD^2))``.

    Attributes:
        factor: A.
        temperature_k: B.
        depth_factor: C.
        exponent: p.
    """

    factor: float
    temperature_k: float
    depth_factor: float
    exponent: float
    cause: Cause = Cause.CYCLIC

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s."""
        depth = np.exp(self.depth_factor * np.exp(use.depth_of_discharge**2))
        k = self.factor * np.exp(self.temperature_k / use.temperature_k) * depth
        rate: FloatArray = k ** (1.0 / self.exponent) * _cycles_1_s(use)
        return rate


@dataclass(frozen=True)
class SmithCalendar:
    """Calendar ageing of Smith et al. (2021): an Arrhenius factor times a polynomial in the state of charge.

    Attributes:
        energy_j_mol: activation energy.
        polynomial: coefficients of the state of charge, the constant first.
        coupling_1_k: of state of charge times temperature.
        hot_1_k: per kelvin above 55 degC.
        exponent: p.
    """

    energy_j_mol: float
    polynomial: tuple[float, ...]
    coupling_1_k: float
    hot_1_k: float
    exponent: float = 0.5
    cause: Cause = Cause.CALENDAR

    def coefficient(self, use: CellUse) -> FloatArray:
        """Return k per day^p."""
        charge, t = use.state_of_charge, use.temperature_k
        shape = sum(factor * charge**power for power, factor in enumerate(self.polynomial))
        shape = shape + self.coupling_1_k * charge * t + self.hot_1_k * np.maximum(t - 328.15, 0.0)
        k: FloatArray = np.maximum(arrhenius(t, self.energy_j_mol) * shape, 0.0)
        return k

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s."""
        rate: FloatArray = self.coefficient(use) ** (1.0 / self.exponent) / SECONDS_PER_DAY
        return rate


@dataclass(frozen=True)
class SmithCyclic:
    """Cyclic ageing of Smith et al. (2021): breaks what calendar ageing has formed, ``k = k_cal b s``.

    Attributes:
        calendar: its calendar ageing.
        charging: factor, activation energy in J/mol, factor of the state of charge and offset of the part that
            grows with the square root of depth times charging rate.
        depth: factor and activation energy in J/mol of the part that grows with the sixth power of the depth.
        scale: s.
        exponent: p.
    """

    calendar: SmithCalendar
    charging: tuple[float, float, float, float]
    depth: tuple[float, float]
    scale: float
    exponent: float = 0.5
    cause: Cause = Cause.CYCLIC

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s."""
        t, depth = use.temperature_k, use.depth_of_discharge
        stress = np.sqrt(depth * use.charge_rate_1_h)
        factor, energy, per_charge, offset = self.charging
        plating = factor * arrhenius(t, energy) * stress * (1.0 + per_charge * use.state_of_charge)
        breaking = np.maximum(plating + offset, 0.0)
        breaking = breaking + self.depth[0] * arrhenius(t, self.depth[1]) * depth**6
        k = self.calendar.coefficient(use) * breaking * self.scale
        rate: FloatArray = k ** (1.0 / self.exponent) * _cycles_1_s(use)
        return rate


@dataclass(frozen=True)
class PaperCyclic:
    """The paper's cyclic ageing (eq. 11 and 12), in terms of ``u = Q^(1/z)``.

    Attributes:
        aging: its coefficients.
        cell: nominal capacity.
    """

    aging: AgingParameters
    cell: CellParameters
    cause: Cause = Cause.CYCLIC

    @property
    def exponent(self) -> float:
        """z of the paper."""
        return self.aging.throughput_exponent

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s: eq. (12) without its power of the present loss, by z."""
        aging, z = self.aging, self.exponent
        energy = aging.compensation_factor_j_mol * use.c_rate_1_h - aging.activation_energy_j_mol
        arrhenius_factor = np.exp(energy / (aging.gas_constant_j_mol_k * use.temperature_k) / z)
        current_a = use.c_rate_1_h * self.cell.nominal_capacity_ah
        scale = aging.pre_exponential_factor ** (1.0 / z) / SECONDS_PER_HOUR
        rate: FloatArray = scale * current_a * arrhenius_factor
        return rate

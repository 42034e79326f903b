"""Growth of the surface film of the anode, which cracking of its particles accelerates under load.

Smith et al., J. Electrochem. Soc. 168, 2021, 100530, doi:10.1149/1945-7111/ac2ebd, with the coefficients of
the BLAST-Lite 1.1.1 release: the terms of the first weeks, which take or release some lithium once, are left
out. Calendar: ``Q = b_t sqrt(days)``; cyclic: ``Q = 0.985 b_t b_N sqrt(n)``, n in equivalent full cycles.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.aging_laws.law import SECONDS_PER_DAY, Load, Mechanism
from iptm_core.aging_laws.mechanisms import cycles_1_s
from iptm_core.physics.ops import Scalar, exp, maximum, sqrt, where

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

    exponent: float = 0.5

    @property
    def mechanism(self) -> Mechanism:
        """Calendar."""
        return Mechanism.CALENDAR

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

    exponent: float = 0.5

    @property
    def mechanism(self) -> Mechanism:
        """Cyclic."""
        return Mechanism.CYCLIC

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

"""The refrigerant cycle as a smooth map: COP and capacity over evaporation, condensation and speed.

    COP = T_e / (T_c - T_e) exp(p(t_e, t_c, n)),    Q / (V n) = exp(q(t_e, t_c, n))

with polynomials p and q of degree 4 that `cycle_fit` fits to cycles by CoolProp. The temperature of
condensation of R744 is the one of the gas cooler's outlet. Outside of `BOUNDS` the map is held at them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

from iptm_core.declaration import TextEnum
from iptm_core.physics.ops import Scalar, exp, maximum, minimum
from iptm_core.units import CELSIUS_ZERO_K

MAPS = Path(__file__).parent / "cycle_maps.json"
LEAST_LIFT_K = 10.0
DEGREE = 4
HELD_K, HELD_HZ = 1.0, 2.0
"""Widths of the smoothed bounds of the map."""


class Refrigerant(TextEnum):
    """What circulates."""

    R1234YF = "R1234yf"
    R134A = "R134a"
    R290 = "R290"
    R744 = "R744"


BOUNDS = {
    fluid: ((-30.0, 20.0), (20.0, 70.0), (15.0, 145.0))
    for fluid in Refrigerant
    if fluid is not Refrigerant.R744
} | {Refrigerant.R744: ((-30.0, 15.0), (12.0, 50.0), (15.0, 145.0))}
"""Evaporation in degC, condensation (R744: outlet of the gas cooler) in degC, speed in 1/s."""
_EXPONENTS = tuple(each for each in product(range(DEGREE + 1), repeat=3) if sum(each) <= DEGREE)


def basis(evaporation_c: Scalar, condensation_c: Scalar, speed_hz: Scalar) -> list[Scalar]:
    """Return the monomials of the polynomials at operating points, of variables of the size of 1."""
    variables = evaporation_c / 30.0, (condensation_c - 40.0) / 30.0, (speed_hz - 80.0) / 65.0
    powers: list[list[Scalar]] = []
    for each in variables:
        own: list[Scalar] = [0.0 * each + 1.0]
        for _ in range(DEGREE):
            own.append(own[-1] * each)
        powers.append(own)
    return [powers[0][i] * powers[1][j] * powers[2][k] for i, j, k in _EXPONENTS]


@dataclass(frozen=True)
class CycleMap:
    """Coefficients of a refrigerant.

    Attributes:
        rms: relative errors of COP and capacity at points that were held out.
        worst: the largest of them.
    """

    fluid: Refrigerant
    cop_coefficients: tuple[float, ...]
    capacity_coefficients: tuple[float, ...]
    rms: tuple[float, float]
    worst: tuple[float, float]

    def within(
        self, evaporation_c: Scalar, condensation_c: Scalar, speed_hz: Scalar
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Return an operating point inside the map, with at least 10 K between both temperatures."""
        (e_low, e_high), (c_low, c_high), (n_low, n_high) = BOUNDS[self.fluid]
        evaporation_c = minimum(maximum(evaporation_c, e_low, HELD_K), e_high, HELD_K)
        condensation_c = maximum(condensation_c, evaporation_c + LEAST_LIFT_K, HELD_K)
        condensation_c = minimum(maximum(condensation_c, c_low, HELD_K), c_high, HELD_K)
        speed_hz = minimum(maximum(speed_hz, n_low, HELD_HZ), n_high, HELD_HZ)
        return evaporation_c, condensation_c, speed_hz

    def performance(
        self, evaporation_c: Scalar, condensation_c: Scalar, speed_hz: Scalar
    ) -> Scalar:
        """Return the COP of cooling: heat into the evaporators per electric power."""
        carnot = (evaporation_c + CELSIUS_ZERO_K) / (condensation_c - evaporation_c)
        return carnot * exp(_sum(self.cop_coefficients, evaporation_c, condensation_c, speed_hz))

    def capacity_j_m3(
        self, evaporation_c: Scalar, condensation_c: Scalar, speed_hz: Scalar
    ) -> Scalar:
        """Return the heat into the evaporators per displaced volume, in J/m^3."""
        return exp(_sum(self.capacity_coefficients, evaporation_c, condensation_c, speed_hz))


def _sum(coefficients: tuple[float, ...], *point: Scalar) -> Scalar:
    terms = (c * term for c, term in zip(coefficients, basis(*point), strict=True))
    return sum(terms, 0.0)


@cache
def cycle_map(fluid: Refrigerant) -> CycleMap:
    """Return the map of a refrigerant."""
    found = json.loads(MAPS.read_text("utf-8"))[fluid.value]
    return CycleMap(
        fluid,
        tuple(found["cop"]),
        tuple(found["capacity"]),
        (found["rms"][0], found["rms"][1]),
        (found["worst"][0], found["worst"][1]),
    )

"""Cooling rate of the chiller from compressor power, paper eq. (14), at an ambient temperature.

The fitted map is linear in the outlet coolant temperature, which lets the coolant loop be solved in closed
form: the map is therefore given as offset and slope. Its temperatures are degrees Celsius.

The map is a parabola over the compressor power and a fit: it is used only where it makes sense. Beyond the
power of its vertex it is held, because a compressor does not cool less for being driven harder; and a
chiller never heats the coolant, so that what it takes is not negative. Both keep the rate monotone in power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import Source, SourceTag, checked_number, field_specs, read_tag
from iptm_core.parameters.model import (
    ChillerParameters,
    CoolingParameters,
    EnvironmentParameters,
    LimitParameters,
)
from iptm_core.physics.ops import Scalar, exp, maximum
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S
from iptm_core.user_input import StrictMapping, check_known, shown


@dataclass(frozen=True)
class ChillerLine:
    """Cooling rate at one compressor power: ``gate max(offset + slope T_c,out, 0)``.

    Attributes:
        offset_w: rate of the fitted map at an outlet temperature of 0 degC.
        slope_w_k: its change with the outlet temperature, not negative.
        gate: 0 with the compressor off, 1 while it runs.
    """

    offset_w: Scalar
    slope_w_k: Scalar
    gate: Scalar

    def cooling_rate_w(self, outlet_k: Scalar, smoothing_w: float = 0.0) -> Scalar:
        """Heat taken from the coolant (Q_co) in W at an outlet temperature, never negative."""
        fitted = self.offset_w + self.slope_w_k * (outlet_k - CELSIUS_ZERO_K)
        return self.gate * maximum(fitted, 0.0, smoothing_w)


def air_mass_flow_kg_s(speed_m_s: Scalar, chiller: ChillerParameters) -> Scalar:
    """Air through the condenser (m_a); the printed coefficient takes the speed in km/h."""
    speed_km_h = KM_H_PER_M_S * speed_m_s
    return chiller.air_flow_at_rest_kg_s + chiller.air_flow_per_speed_kg_s_per_km_h * speed_km_h


def compressor_gate(power_w: Scalar, chiller: ChillerParameters) -> Scalar:
    """Smooth switch from 0 (compressor off) to 1 (running), ``1 - exp(-(P_cp / P_gate)^2)``.

    The fitted map alone would cool with the compressor off. Without a gate (P_gate = 0) it does: 1.
    """
    if chiller.gate_power_w == 0.0:
        return 1.0
    relative = power_w / chiller.gate_power_w
    return 1.0 - exp(-relative * relative)


def largest_useful_power_w(chiller: ChillerParameters, limits: LimitParameters) -> float:
    """Return the compressor power beyond which more is of no use: the vertex of the map or the limit."""
    return min(_vertex_w(chiller), limits.max_compressor_power_w)


def chiller_line(
    compressor_power_w: Scalar,
    speed_m_s: Scalar,
    chiller: ChillerParameters,
    cooling: CoolingParameters,
    environment: EnvironmentParameters,
) -> ChillerLine:
    """The gated chiller map (eq. 14) at a compressor power and a vehicle speed."""
    ambient_c = environment.ambient_temperature_k - CELSIUS_ZERO_K
    # The slope of the parabola vanishes at its vertex: holding it there leaves the map differentiable.
    power = compressor_power_w
    vertex = _vertex_w(chiller)
    if math.isfinite(vertex):
        power = -maximum(-power, -vertex)
    offset = (
        chiller.xi_1 * power
        + chiller.xi_2_1_w * power * power
        + chiller.xi_4_j_kg_k * ambient_c * air_mass_flow_kg_s(speed_m_s, chiller)
        + chiller.xi_6_w
    )
    # A difference of two large numbers: both coefficients keep every published digit.
    slope = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * cooling.coolant_mass_flow_kg_s
    return ChillerLine(offset, slope, compressor_gate(compressor_power_w, chiller))


def _vertex_w(chiller: ChillerParameters) -> float:
    """Return the power of the parabola's vertex, infinite where it opens upwards or is a line."""
    if chiller.xi_2_1_w >= 0.0:
        return math.inf
    return max(-chiller.xi_1 / (2.0 * chiller.xi_2_1_w), 0.0)


AMBIENT_KEY = "environment.ambient_temperature_k"
COEFFICIENT_KEYS = tuple(key for key in field_specs() if key.startswith("chiller.xi_"))
_EDGE_K = 1e-9  # round-off of a conversion may not push an edge of the table outside of it


@dataclass(frozen=True)
class ChillerTable:
    """Chiller coefficients at increasing ambient temperatures.

    Attributes:
        ambient_k: ambient temperatures, shape (n,), increasing, n >= 2.
        coefficients: dotted key -> values at those temperatures, shape (n,), in the model's units.
    """

    origin: str
    ambient_k: tuple[float, ...]
    coefficients: Mapping[str, tuple[float, ...]]
    tag: SourceTag
    note: str

    def at(self, ambient_k: float) -> dict[str, Source]:
        """Interpolate the coefficients; a row is met to the last digit, beyond the table is refused."""
        nodes_k = self.ambient_k
        if not nodes_k[0] - _EDGE_K <= ambient_k <= nodes_k[-1] + _EDGE_K:
            raise ParameterError(
                f"{self.origin}: {AMBIENT_KEY} is {ambient_k!r}, outside of the chiller table; "
                f"allowed: {nodes_k[0]:g} to {nodes_k[-1]:g} K"
            )
        for row, node_k in enumerate(nodes_k):
            if math.isclose(node_k, ambient_k, rel_tol=0.0, abs_tol=_EDGE_K):
                values = {key: column[row] for key, column in self.coefficients.items()}
                return self._sources(values, self.note)
        upper = next(row for row, node_k in enumerate(nodes_k) if node_k > ambient_k)
        low_k, high_k = nodes_k[upper - 1 : upper + 1]
        share = (ambient_k - low_k) / (high_k - low_k)
        values = {
            key: column[upper - 1] + share * (column[upper] - column[upper - 1])
            for key, column in self.coefficients.items()
        }
        remark = f"interpolated between {low_k:g} and {high_k:g} K ambient"
        return self._sources(values, "; ".join(filter(None, (self.note, remark))))

    def _sources(self, values: Mapping[str, float], note: str) -> dict[str, Source]:
        return {
            key: Source(value, field_specs()[key].unit, self.tag, note)
            for key, value in values.items()
        }


def read_chiller_table(entry: object, key: str, origin: str) -> ChillerTable:
    """Read the table of ``chiller.by_ambient_temperature``."""
    where = f"{origin}: {key}"
    known = ("source", "note", "columns", "units", "rows")
    written = StrictMapping(entry, where, known, kind="entry", error=ParameterError)
    tag, note = read_tag(written), written.text("note", "")
    by_name = {key.split(".")[1]: field_specs()[key] for key in (AMBIENT_KEY, *COEFFICIENT_KEYS)}
    names = written.entries("columns")
    for name in names:
        check_known(name, by_name, where, "column")
    if sorted(names) != sorted(by_name):
        written.refuse("columns", f"each of {', '.join(by_name)} once")
    units, rows = written.entries("units"), written.entries("rows")
    if len(units) != len(names):
        written.refuse("units", f"a list of {len(names)} units, one for each column")
    if len(rows) < 2:
        written.refuse("rows", "a list of at least two rows")
    columns: dict[str, list[float]] = {by_name[name].name: [] for name in names}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != len(names):
            raise ParameterError(
                f"{where}: rows, row {number} is {shown(row)}; allowed: a list of {len(names)} numbers"
            )
        for name, unit, value in zip(names, units, row, strict=True):
            spec = by_name[name]
            columns[spec.name].append(checked_number(value, spec, f"{where}, row {number}", unit))
    ambient_k = tuple(columns.pop(AMBIENT_KEY))
    if any(low >= high for low, high in pairwise(ambient_k)):
        raise ParameterError(
            f"{where}: ambient temperatures are {shown(ambient_k)} K; allowed: increasing ones"
        )
    coefficients = {key: tuple(columns[key]) for key in COEFFICIENT_KEYS}
    return ChillerTable(origin, ambient_k, coefficients, tag, note)

"""Capacity loss of a cell by several mechanisms, each of which follows a power law.

A mechanism loses ``Q = k t^p`` (calendar) or ``Q = k n^p`` (cyclic, n the throughput in equivalent full cycles) at
constant conditions. In ``u = Q^(1/p)`` that is linear, ``du = k^(1/p) dt``, so that u is a state for any sequence of
conditions: its rate depends on the conditions only, not on the age. The losses of the mechanisms add up.

The paper's law (eq. 11 and 12) is one of these mechanisms, with the throughput in ampere-hours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from iptm_core.state import FloatArray
from iptm_core.text_enum import TextEnum


class Cause(TextEnum):
    """What a mechanism needs to go on."""

    CALENDAR = "calendar"
    CYCLIC = "cyclic"


@dataclass(frozen=True)
class CellUse:
    """Conditions of a cell; arrays of one shape, or scalars.

    Attributes:
        temperature_k: cell temperature.
        state_of_charge: from 0 to 1.
        c_rate_1_h: magnitude of the current by the nominal capacity, discharge and charge alike.
        depth_of_discharge: swing of the state of charge of the cycle that these conditions are part of.
        charge_rate_1_h: C-rate of the charging that belongs to this cycle.
    """

    temperature_k: FloatArray
    state_of_charge: FloatArray
    c_rate_1_h: FloatArray
    depth_of_discharge: FloatArray
    charge_rate_1_h: FloatArray


class Mechanism(Protocol):
    """One way in which a cell loses capacity.

    Attributes:
        cause: time alone, or throughput.
        exponent: p of the power law.
    """

    @property
    def cause(self) -> Cause: ...

    @property
    def exponent(self) -> float: ...

    def rate_1_s(self, use: CellUse) -> FloatArray:
        """Return du/dt in 1/s at the conditions, shape of the conditions, never negative."""
        ...


@dataclass(frozen=True)
class ValidRange:
    """Range of the experiments behind a law.

    Attributes:
        temperature_k: least and largest cell temperature.
        state_of_charge: least and largest state of charge.
        largest_c_rate_1_h: largest C-rate.
    """

    temperature_k: tuple[float, float]
    state_of_charge: tuple[float, float]
    largest_c_rate_1_h: float

    def holds(self, use: CellUse) -> FloatArray:
        """Return 1 where conditions are inside the range, else 0; shape of the conditions."""
        low_k, high_k = self.temperature_k
        low, high = self.state_of_charge
        inside = (
            (use.temperature_k >= low_k)
            & (use.temperature_k <= high_k)
            & (use.state_of_charge >= low)
            & (use.state_of_charge <= high)
            & (use.c_rate_1_h <= self.largest_c_rate_1_h)
        )
        return np.asarray(inside, dtype=np.float64)


@dataclass(frozen=True)
class DegradationLaw:
    """Law of a cell.

    Attributes:
        name: of the cell.
        chemistry: of its electrodes.
        mechanisms: losses that add up.
        valid: range of the experiments behind it.
        source: publications.
    """

    name: str
    chemistry: str
    mechanisms: tuple[Mechanism, ...]
    valid: ValidRange
    source: str

    def rates_1_s(self, use: CellUse) -> list[FloatArray]:
        """Return du/dt of every mechanism at the conditions, in 1/s."""
        return [mechanism.rate_1_s(use) for mechanism in self.mechanisms]

    def losses(self, states: Sequence[float]) -> list[float]:
        """Return the capacity loss by every mechanism as fractions of nominal, from the states u."""
        return [
            float(max(state, 0.0) ** mechanism.exponent)
            for mechanism, state in zip(self.mechanisms, states, strict=True)
        ]

    def sensitivities_1_k(self, use: CellUse, step_k: float = 0.1) -> list[FloatArray]:
        """Return d ln(du/dt) / dT of every mechanism in 1/K, by central differences; 0 where it rests."""
        rates = [
            self.rates_1_s(_at(use, use.temperature_k + shift)) for shift in (-step_k, step_k)
        ]
        slopes = []
        for low, high in zip(*rates, strict=True):
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.log(high / low) / (2.0 * step_k)
            slopes.append(np.where(np.isfinite(slope), slope, 0.0))
        return slopes


def _at(use: CellUse, temperature_k: FloatArray) -> CellUse:
    return CellUse(**{**vars(use), "temperature_k": temperature_k})

"""Coolant temperature along a channel, paper eqs. (9) and (10): its first/last-cell reduction, and all cells.

The coolant passes the cells of a channel one after the other and takes up ``h (T_bc - T_c)`` from each.
``C_f`` of eq. (10) is a heat-capacity rate in W/K (``C_p m_c / N_m``), independent of any sampling time.
All cells carry the same current, as the paper assumes under eq. (6).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iptm_core.parameters.model import CellParameters, CoolingParameters, PackParameters
from iptm_core.physics.ops import Scalar


def exchange_ratio(cooling: CoolingParameters, pack: PackParameters) -> float:
    """Share of the temperature difference that the coolant takes up at one cell, r = h / C_f."""
    capacity_rate_w_k = (
        cooling.coolant_specific_heat_j_kg_k * cooling.coolant_mass_flow_kg_s / pack.modules
    )
    return cooling.convective_coefficient_w_k / capacity_rate_w_k


@dataclass(frozen=True)
class ChannelWeights:
    """A coolant temperature as a weighted mean of inlet, first and last cell; the weights add up to 1."""

    inlet: float
    cell_1: float
    cell_n: float

    def temperature_k(self, inlet_k: Scalar, cell_1_k: Scalar, cell_n_k: Scalar) -> Scalar:
        """Coolant temperature in K."""
        return self.inlet * inlet_k + self.cell_1 * cell_1_k + self.cell_n * cell_n_k


@dataclass(frozen=True)
class Channel:
    """The two-cell reduction of a channel: coolant at the last cell (T_c,Nc) and at the outlet (T_c,out)."""

    last_cell: ChannelWeights
    outlet: ChannelWeights


def reduce_channel(cooling: CoolingParameters, pack: PackParameters) -> Channel:
    """Weights of eq. (9) for a linear temperature profile between the first and the last cell.

    The linear profile is what the channel settles to when all cells heat alike; the full sum over all
    cells then collapses to three fixed weights.
    """
    ratio = exchange_ratio(cooling, pack)
    cells = pack.cells_per_channel
    return Channel(_weights_behind(cells - 1, cells, ratio), _weights_behind(cells, cells, ratio))


def _weights_behind(passed: int, cells: int, ratio: float) -> ChannelWeights:
    """Weights of the coolant temperature after ``passed`` of ``cells`` cells."""
    order = np.arange(passed)
    shares = ratio * (1.0 - ratio) ** (passed - 1 - order)
    last = order / (cells - 1)
    return ChannelWeights(
        inlet=float((1.0 - ratio) ** passed),
        cell_1=float(np.sum(shares * (1.0 - last))),
        cell_n=float(np.sum(shares * last)),
    )


@dataclass(frozen=True)
class FullChannel:
    """One coolant channel; at each cell the coolant takes up the share ``ratio`` of the difference."""

    cells: int
    ratio: float

    @classmethod
    def of(cls, cooling: CoolingParameters, pack: PackParameters) -> FullChannel:
        """Return the channel of a parameter set."""
        return cls(pack.cells_per_channel, exchange_ratio(cooling, pack))

    def coolant_k(self, inlet_k: Scalar, cells_k: Any) -> list[Scalar]:
        """Coolant temperature in front of each cell and behind the last one (eq. 9), N_c + 1 of them.

        The recursion of which eq. (9) is the sum: each cell warms the coolant by its share of the difference.
        """
        reaching = [inlet_k]
        for i in range(self.cells):
            reaching.append(reaching[-1] + self.ratio * (cells_k[i] - reaching[-1]))
        return reaching

    @property
    def outlet(self) -> ChannelWeights:
        """Weights of the outlet temperature for a channel whose cells have one temperature.

        With `equivalent_cell_k` for it they hold for any cells: the outlet is affine in the inlet, so that
        the loop closes with the chiller just as it does in the reduced channel.
        """
        passed = (1.0 - self.ratio) ** self.cells
        return ChannelWeights(inlet=passed, cell_1=1.0 - passed, cell_n=0.0)

    def equivalent_cell_k(self, cells_k: Any) -> Scalar:
        """Mean of the cell temperatures, weighted with what of each gets as far as the outlet."""
        return self.coolant_k(0.0, cells_k)[-1] / self.outlet.cell_1


def mean_cell_heat_w(
    mean_current_a: Scalar,
    mean_square_current_a2: Scalar,
    resistance_ohm: Scalar,
    temperature_k: Scalar,
    cell: CellParameters,
) -> Scalar:
    """Mean heat of a cell over instants of different current; ``cell_heat_w`` is quadratic in it."""
    entropic = mean_current_a * cell.entropic_coefficient_v_k
    return mean_square_current_a2 * resistance_ohm + entropic * temperature_k

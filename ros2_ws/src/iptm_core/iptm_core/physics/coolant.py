"""Coolant temperature along a channel, paper eqs. (9) and (10), and its first/last-cell reduction.

The coolant passes the cells of a channel one after the other and takes up ``h (T_bc - T_c)`` from each.
``C_f`` of eq. (10) is a heat-capacity rate in W/K (``C_p m_c / N_m``), independent of any sampling time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import CoolingParameters, PackParameters
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
    """The two-cell reduction of one coolant channel.

    Attributes:
        last_cell: weights of the coolant temperature that the last cell meets (T_c,Nc).
        outlet: weights of the outlet temperature (T_c,out).
    """

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

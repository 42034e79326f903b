"""Every cell of a coolant channel, paper eqs. (6) to (15) without the first/last-cell reduction.

All cells carry the same current, as the paper assumes under eq. (6); each has its own temperature,
resistance, heat and capacity loss, and meets the coolant that the cells before it have warmed. Cells come
as a vector: a sequence of floats, an array or a column of CasADi symbols.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iptm_core.parameters.model import CellParameters, CoolingParameters, PackParameters
from iptm_core.physics.coolant import ChannelWeights, exchange_ratio
from iptm_core.physics.ops import Scalar


@dataclass(frozen=True)
class FullChannel:
    """One coolant channel.

    Attributes:
        cells: number of cells N_c.
        ratio: share of the temperature difference that the coolant takes up at one cell, r.
    """

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
    """Mean heat of a cell over instants of different current; ``cell_heat_w`` is quadratic in it.

    Args:
        mean_current_a: mean of the cell current over the instants.
        mean_square_current_a2: mean of its square.
        resistance_ohm: resistance, the same at all instants.
        temperature_k: temperature, the same at all instants.
        cell: entropic coefficient.
    """
    entropic = mean_current_a * cell.entropic_coefficient_v_k
    return mean_square_current_a2 * resistance_ohm + entropic * temperature_k

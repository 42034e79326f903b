"""Road slope over position, on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.routes.hills import Hills
from iptm_core.routes.piecewise import read_only_nodes
from iptm_core.state import FloatArray

MAX_GRADE = 0.3
"""Steepest road that the project accepts, rise over run."""

ELEVATION_SPACING_M = 20.0
"""Spacing on which elevations are differentiated; closer points would amplify their noise."""


@dataclass(frozen=True, eq=False)
class SlopeProfile:
    """Slope of the road (theta), linear between nodes and held beyond the ends.

    Attributes:
        positions_m: node positions along the road, shape (n,), increasing; 0 is the host's start.
        slopes_rad: slope at the nodes, shape (n,), positive uphill.

    Raises:
        RouteError: malformed nodes or a slope beyond 30 %.
    """

    positions_m: FloatArray
    slopes_rad: FloatArray

    def __post_init__(self) -> None:
        positions, slopes = read_only_nodes(self.positions_m, self.slopes_rad, "slope profile")
        worst = int(np.argmax(np.abs(slopes)))
        if abs(slopes[worst]) > np.arctan(MAX_GRADE) + 1e-12:
            raise RouteError(
                f"slope profile: {100.0 * np.tan(slopes[worst]):.1f} % at {positions[worst]:.1f} m; "
                f"allowed: -{100.0 * MAX_GRADE:g} % to {100.0 * MAX_GRADE:g} %"
            )
        object.__setattr__(self, "positions_m", positions)
        object.__setattr__(self, "slopes_rad", slopes)

    @classmethod
    def flat(cls) -> SlopeProfile:
        """Level road everywhere."""
        return cls(np.zeros(1), np.zeros(1))

    @classmethod
    def from_hills(cls, stretches: Sequence[Hills], mean_climb: float = 0.0) -> SlopeProfile:
        """Sample generated hills on their own grids and join them.

        Args:
            stretches: hills in the order of the road; each starts where the one before ends.
            mean_climb: grade of the road under the hills, rise over run.

        Returns:
            The profile; the road climbs evenly before the first and after the last stretch.
        """
        positions: FloatArray = np.zeros(0)
        slopes: FloatArray = np.zeros(0)
        for hills in stretches:
            grid = hills.grid_m()
            # The slope is zero at every joint, which therefore needs one node only.
            keep = slice(1, None) if positions.size else slice(None)
            positions = np.append(positions, grid[keep])
            slopes = np.append(slopes, hills.slope_at(grid[keep]))
        if positions.size == 0:
            return cls(np.zeros(1), np.array([np.arctan(mean_climb)]))
        return cls(positions, slopes + np.arctan(mean_climb))

    @classmethod
    def from_elevations(cls, positions_m: ArrayLike, elevations_m: ArrayLike) -> SlopeProfile:
        """Differentiate a height profile.

        The heights are first read off every 20 m (`ELEVATION_SPACING_M`); each slope node lies in
        the middle between two of these points.

        Args:
            positions_m: distances along the road, shape (n,), increasing.
            elevations_m: heights there, shape (n,), above any datum.

        Returns:
            The profile.

        Raises:
            RouteError: malformed input or a slope beyond 30 %.
        """
        positions, heights = read_only_nodes(positions_m, elevations_m, "elevation profile")
        length = positions[-1] - positions[0]
        intervals = max(1, round(length / ELEVATION_SPACING_M))
        if length <= 0.0:
            return cls.flat()
        grid = np.linspace(positions[0], positions[-1], intervals + 1)
        sines = np.diff(np.interp(grid, positions, heights)) / np.diff(grid)
        # A sine beyond 1 is not a slope; clipped to 1 it is reported as too steep.
        slopes = np.arcsin(np.clip(sines, -1.0, 1.0))
        return cls(0.5 * (grid[1:] + grid[:-1]), slopes)

    def slope_at(self, position_m: ArrayLike) -> FloatArray:
        """Interpolate the slope.

        Args:
            position_m: positions along the road, any shape.

        Returns:
            Slope in rad, positive uphill, same shape.
        """
        return np.interp(
            np.asarray(position_m, dtype=np.float64), self.positions_m, self.slopes_rad
        )

"""Road slope over position on a grid: from heights, or of generated hills.

Hills are a smooth, deterministic slope over a stretch of road that returns to its height. With the relative
position x in [0, 1] along the stretch, the slope is

    theta(x) = c (1 - cos(pi x)^8) sum_i w_i sin(2 pi k_i x + phi_i),    k_i integer, k_i >= 5

The window makes the slope and its first derivative vanish at both ends, so that stretches join
smoothly. The window holds the harmonics 0 to 4 only, which is why its product with harmonics of
order 5 and more has a mean of exactly zero, whatever the phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import read_only_nodes
from iptm_core.state import FloatArray

PEAK_GRADES = {"small": 0.02, "large": 0.06}
"""Steepest grade (rise over run) of the two kinds of hills."""

MAIN_WAVELENGTH_M = 2000.0
"""Length of a hill where nothing else is asked for."""

_LOWEST_HARMONIC = 5
_HARMONIC_RATIOS = (1.0, 1.6, 2.6)
_WEIGHTS = (1.0, 0.5, 0.25)
_GOLDEN_RATIO = 0.5 * (1.0 + 5.0**0.5)
_NODES_PER_SHORTEST_WAVE = 40
_MIN_LENGTH_M = 50.0


@dataclass(frozen=True)
class Hills:
    """Hills over one stretch of road.

    Attributes:
        length_m: its length, at least 50 m; it holds at least five hills.
        peak_grade: steepest grade, rise over run.
        variant: integer >= 0 that chooses the phases, hence the shape.
        wavelength_m: length of a hill, at most a fifth of the stretch.
    """

    start_m: float
    length_m: float
    peak_grade: float
    variant: int = 0
    wavelength_m: float = MAIN_WAVELENGTH_M
    _scale_rad: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.start_m) and np.isfinite(self.length_m)) or (
            self.length_m < _MIN_LENGTH_M
        ):
            raise RouteError(
                f"hills from {self.start_m} m over {self.length_m} m; "
                f"allowed: finite positions and at least {_MIN_LENGTH_M:g} m"
            )
        if not 0.0 <= self.peak_grade <= 0.3:
            raise RouteError(f"hills of grade {self.peak_grade}; allowed: 0 to 0.3")
        if self.variant < 0:
            raise RouteError(f"hills of variant {self.variant}; allowed: an integer >= 0")
        if not (np.isfinite(self.wavelength_m) and self.wavelength_m >= _MIN_LENGTH_M):
            raise RouteError(
                f"hills of length {self.wavelength_m} m; allowed: at least {_MIN_LENGTH_M:g} m"
            )
        count = 8 * _NODES_PER_SHORTEST_WAVE * self.wave_numbers[-1]
        dense = np.linspace(0.0, 1.0, count, dtype=np.float64)
        highest = float(np.max(np.abs(self._shape(dense))))
        object.__setattr__(self, "_scale_rad", float(np.arctan(self.peak_grade)) / highest)

    @property
    def wave_numbers(self) -> tuple[int, ...]:
        """Number of waves of each harmonic over the stretch (k_i)."""
        lowest = max(_LOWEST_HARMONIC, round(self.length_m / self.wavelength_m))
        return tuple(round(lowest * ratio) for ratio in _HARMONIC_RATIOS)

    def slope_at(self, position_m: ArrayLike) -> FloatArray:
        """Return the slope in rad, positive uphill, shape of the positions; 0 outside the stretch."""
        x = (np.asarray(position_m, dtype=np.float64) - self.start_m) / self.length_m
        return self._scale_rad * self._shape(np.clip(x, 0.0, 1.0))

    def grid_m(self) -> FloatArray:
        """Positions, shape (n,); between them lines stay within 1e-4 rad for grades up to 6 %."""
        nodes = _NODES_PER_SHORTEST_WAVE * self.wave_numbers[-1] + 1
        return self.start_m + self.length_m * np.linspace(0.0, 1.0, nodes, dtype=np.float64)

    def _shape(self, x: FloatArray) -> FloatArray:
        waves = np.zeros_like(x)
        for index, (number, weight) in enumerate(zip(self.wave_numbers, _WEIGHTS, strict=True)):
            # Multiples of the golden ratio spread the phases evenly for any variant.
            phase = 2.0 * np.pi * ((1 + index + len(_WEIGHTS) * self.variant) * _GOLDEN_RATIO % 1.0)
            waves += weight * np.sin(2.0 * np.pi * number * x + phase)
        result: FloatArray = (1.0 - np.cos(np.pi * x) ** 8) * waves
        return result


MAX_GRADE = 0.3
"""Steepest road that the project accepts, rise over run."""

ELEVATION_SPACING_M = 20.0
"""Spacing on which elevations are differentiated; closer points would amplify their noise."""


@dataclass(frozen=True, eq=False)
class SlopeProfile:
    """Slope of the road (theta), linear between nodes and held beyond the ends.

    Attributes:
        positions_m: node positions along the road, shape (n,), increasing; 0 is the ego vehicle's start.
        slopes_rad: slope at the nodes, shape (n,), positive uphill.
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
        """Join generated hills, in the order of the road; before and after them the road climbs evenly."""
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

        The heights, shape (n,) like their increasing positions, are first read off every 20 m
        (`ELEVATION_SPACING_M`); each slope node lies in the middle between two of these points.
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
        """Return the interpolated slope in rad, positive uphill, shape of the positions."""
        positions_m = np.asarray(position_m, dtype=np.float64)
        if self.positions_m.size == 1:
            level: FloatArray = self.slopes_rad[0] + 0.0 * positions_m  # NaN stays NaN
            return level
        return np.interp(positions_m, self.positions_m, self.slopes_rad)

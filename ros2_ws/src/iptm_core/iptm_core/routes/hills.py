"""Generated hills: a smooth, deterministic slope over a stretch of road that returns to its height.

With the relative position x in [0, 1] along the stretch, the slope is

    theta(x) = c (1 - cos(pi x)^8) sum_i w_i sin(2 pi k_i x + phi_i),    k_i integer, k_i >= 5

The window makes the slope and its first derivative vanish at both ends, so that stretches join
smoothly. The window holds the harmonics 0 to 4 only, which is why its product with harmonics of
order 5 and more has a mean of exactly zero, whatever the phases.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
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
        start_m: position of the start of the stretch.
        length_m: its length, at least 50 m; it holds at least five hills.
        peak_grade: steepest grade, rise over run.
        variant: integer >= 0 that chooses the phases, hence the shape.
        wavelength_m: length of a hill, at most a fifth of the stretch.

    Raises:
        RouteError: a value outside its range.
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
        """Evaluate the smooth slope.

        Args:
            position_m: positions along the road, any shape.

        Returns:
            Slope in rad, positive uphill, same shape; 0 outside the stretch.
        """
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

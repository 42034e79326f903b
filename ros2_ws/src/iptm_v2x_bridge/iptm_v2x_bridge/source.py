"""Where predictions come from, before the radio link spoils them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from iptm_core.errors import ParameterError
from iptm_core.state import FloatArray, LeaderPreview, LeaderState

NS_PER_S = 1_000_000_000

MIN_LENGTH_S = 1.0
MAX_LENGTH_S = 3600.0
MIN_STEP_S = 0.01


@dataclass(frozen=True)
class PreviewGrid:
    """Node times of a prediction relative to its generation: 0, step, 2 step, ... up to length.

    Attributes:
        length_s: how far a prediction reaches, 1 s to 3600 s.
        step_s: time between nodes, 0.01 s to the length.

    Raises:
        ParameterError: length or step out of range.
    """

    length_s: float = 60.0
    step_s: float = 1.0

    def __post_init__(self) -> None:
        if not MIN_LENGTH_S <= self.length_s <= MAX_LENGTH_S:
            raise ParameterError(
                f"preview length is {self.length_s} s; allowed: {MIN_LENGTH_S:g} to {MAX_LENGTH_S:g}"
            )
        if not MIN_STEP_S <= self.step_s <= self.length_s:
            raise ParameterError(
                f"preview step is {self.step_s} s; allowed: {MIN_STEP_S:g} to the preview length, "
                f"{self.length_s:g} s"
            )

    def times_s(self, generated_ns: int) -> FloatArray:
        """Return absolute node times, shape (n,), exact to the nanosecond.

        Args:
            generated_ns: instant of generation in integer nanoseconds of trip time.
        """
        step_ns = round(self.step_s * NS_PER_S)
        count = round(self.length_s * NS_PER_S) // step_ns + 1
        nodes = generated_ns + step_ns * np.arange(count, dtype=np.int64)
        times: FloatArray = nodes / 1e9
        return times


class PreviewSource(Protocol):
    """Knows the leader: where it is, and what it will do as far as anyone can tell."""

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at an instant (integer nanoseconds of trip time)."""
        ...

    def predict(self, generated_ns: int, grid: PreviewGrid) -> LeaderPreview:
        """Return the prediction made at an instant; its first node is `leader_at` that instant."""
        ...

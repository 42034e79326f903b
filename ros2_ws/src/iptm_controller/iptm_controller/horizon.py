"""Prediction horizons as data: a list of phases, each a number of equal steps.

``15x1`` is the paper's single horizon (SH), ``3x1+5x5`` its proposed multi-horizon (MH): both are the
same code with another list.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from iptm_core.errors import ParameterError
from iptm_core.state import FloatArray

MAX_STEP_S = 60.0
MAX_NODES = 20000
_PHASE = re.compile(r"^\s*(\d+)\s*[x*]\s*([0-9]*\.?[0-9]+)\s*(?:s)?\s*$")


@dataclass(frozen=True)
class HorizonPhase:
    """``steps`` equal steps of ``step_s`` seconds."""

    steps: int
    step_s: float

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= MAX_NODES:
            raise ParameterError(f"horizon phase has {self.steps} steps; allowed: 1 to {MAX_NODES}")
        if not (math.isfinite(self.step_s) and 0.05 <= self.step_s <= MAX_STEP_S):
            raise ParameterError(
                f"horizon phase has a step of {self.step_s} s; allowed: 0.05 to {MAX_STEP_S:g} s"
            )


@dataclass(frozen=True)
class Horizon:
    """Phases in time order.

    Attributes:
        phases: at least one phase; step lengths never shrink from one phase to the next.
    """

    phases: tuple[HorizonPhase, ...]

    def __post_init__(self) -> None:
        if not self.phases:
            raise ParameterError("horizon has no phase; allowed: at least one, such as '3x1+5x5'")
        lengths = [phase.step_s for phase in self.phases]
        if lengths != sorted(lengths):
            raise ParameterError(
                f"horizon step lengths are {lengths} s; allowed: lengths that do not shrink with time"
            )

    @classmethod
    def parse(cls, text: str) -> Horizon:
        """Read a horizon such as ``3x1+5x5`` (steps x seconds, joined by ``+``).

        Raises:
            ParameterError: the text is not of this form or a value is out of range.
        """
        phases = []
        for part in text.split("+"):
            match = _PHASE.match(part)
            if match is None:
                raise ParameterError(
                    f"horizon '{text}' cannot be read at '{part}'; allowed: '<steps>x<seconds>' "
                    "parts joined by '+', such as '3x1+5x5'"
                )
            phases.append(HorizonPhase(int(match[1]), float(match[2])))
        return cls(tuple(phases))

    def __str__(self) -> str:
        return "+".join(f"{phase.steps}x{phase.step_s:g}" for phase in self.phases)

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return sum(phase.steps for phase in self.phases)

    @property
    def step_lengths_s(self) -> FloatArray:
        """Length of every step, shape (N,)."""
        return np.concatenate([np.full(phase.steps, phase.step_s) for phase in self.phases])

    @property
    def node_times_s(self) -> FloatArray:
        """Node times from 0 to the end of the horizon, shape (N + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.step_lengths_s)])

    @property
    def duration_s(self) -> float:
        """Length of the horizon in seconds."""
        return float(self.node_times_s[-1])


SINGLE_HORIZON = Horizon((HorizonPhase(15, 1.0),))
MULTI_HORIZON = Horizon((HorizonPhase(3, 1.0), HorizonPhase(5, 5.0)))

"""Prediction horizons as data: a list of phases, each a number of equal steps.

``15x1`` is the paper's single horizon (SH), ``3x1+5x5`` its proposed multi-horizon (MH): both are the
same code with another list. Phases with a ``t`` behind are thermal, such as the last one of
``3x1+5x5+10x30t``: their steps carry on cell temperatures and compressor power, the motion is predicted.
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
_PHASE = re.compile(r"^\s*(\d+)\s*[x*]\s*([0-9]*\.?[0-9]+)\s*(?:s)?\s*(t?)\s*$")


@dataclass(frozen=True)
class HorizonPhase:
    """``steps`` equal steps of ``step_s`` seconds; of a thermal phase the motion is not optimised."""

    steps: int
    step_s: float
    thermal: bool = False

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
        kinds = [phase.thermal for phase in self.phases]
        if kinds[0] or kinds != sorted(kinds):
            raise ParameterError(
                f"horizon '{self}' has a thermal phase before one of motion; allowed: thermal phases last"
            )

    @classmethod
    def parse(cls, text: str) -> Horizon:
        """Read a horizon such as ``3x1+5x5``: steps x seconds, joined by ``+``, thermal ones with a ``t``."""
        phases = []
        for part in text.split("+"):
            match = _PHASE.match(part)
            if match is None:
                raise ParameterError(
                    f"horizon '{text}' cannot be read at '{part}'; allowed: '<steps>x<seconds>' "
                    "parts joined by '+', such as '3x1+5x5', thermal ones with a 't' behind"
                )
            phases.append(HorizonPhase(int(match[1]), float(match[2]), bool(match[3])))
        return cls(tuple(phases))

    def __str__(self) -> str:
        return "+".join(
            f"{phase.steps}x{phase.step_s:g}{'t' if phase.thermal else ''}" for phase in self.phases
        )

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return sum(phase.steps for phase in self.phases)

    @property
    def motion_steps(self) -> int:
        """Number of steps in which the motion is optimised; they come first."""
        return sum(phase.steps for phase in self.phases if not phase.thermal)

    @property
    def motion_duration_s(self) -> float:
        """Length of the part of the horizon in which the motion is optimised."""
        return float(self.node_times_s[self.motion_steps])

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

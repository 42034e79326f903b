"""The flat vectors of one problem: which entry belongs to which step of the horizon.

Variables are ordered ``x_0, u_0, x_1, u_1, ..., x_N``, constraint rows ``dynamics_0, limits_0, dynamics_1,
...``, the order that structure-exploiting solvers read. Parameters are the globals, then those of every
step: its own and one group per quadrature sample. Everything that packs or cuts one of these vectors uses
the grid. The stages of a phase are alike; offsets are summed over the phases, so that a phase with stages
of another size only has to state it in its ``StageKind``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_core.state import FloatArray

MIDPOINT_UP_TO_S = 1.0
SECONDS_PER_SAMPLE = 2.5
POWER_LEVELS = 3
"""Samples of a thermal step: its traction powers, sorted, in groups of equal duration."""


def sample_count(step_s: float) -> int:
    """Return the samples that a step needs: the midpoint up to 1 s, then one per 2.5 s."""
    if step_s <= MIDPOINT_UP_TO_S:
        return 1
    return max(2, math.ceil(step_s / SECONDS_PER_SAMPLE))


@cache
def quadrature(samples: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Legendre nodes and weights on [0, 1], shapes (samples,)."""
    nodes, weights = np.polynomial.legendre.leggauss(samples)
    return 0.5 * (nodes + 1.0), 0.5 * weights


@dataclass(frozen=True)
class StageKind:
    """The equal stages of one phase and their place in the flat vectors.

    Attributes:
        steps: numbers of the steps.
        variables: place of the blocks ``x_k, u_k``.
        rows: place of the blocks ``dynamics_k, limits_k``.
        parameters: place of the parameters of the steps.
        thermal: the motion of the steps is predicted, not optimised.
    """

    step_s: float
    samples: int
    steps: slice
    variables: slice
    rows: slice
    parameters: slice
    thermal: bool

    @property
    def count(self) -> int:
        """Number of stages."""
        return int(self.steps.stop - self.steps.start)

    @property
    def parameter_count(self) -> int:
        """Number of parameters of one step."""
        return layout.step_parameter_count(self.samples)


class ProblemGrid:
    """Sizes, offsets and packing of the flat vectors of a horizon.

    Attributes:
        horizon: the steps.
        stages: one kind per phase.
        sample_times_s: times of all quadrature samples from the first node on, in order; the samples of
            a thermal step are not instants and are placed at its middle.
        step_places: place of the first parameter of every step.
        sample_places: place of the first parameter of every sample.
        motion_samples: number of samples in which the motion is optimised; they come first.
    """

    def __init__(self, horizon: Horizon) -> None:
        self.horizon = horizon
        kinds: list[StageKind] = []
        step, offset = 0, layout.GLOBALS
        for phase in horizon.phases:
            samples = POWER_LEVELS if phase.thermal else sample_count(phase.step_s)
            last = step + phase.steps
            end = offset + phase.steps * layout.step_parameter_count(samples)
            kinds.append(
                StageKind(
                    step_s=phase.step_s,
                    samples=samples,
                    steps=slice(step, last),
                    variables=slice(layout.BLOCK * step, layout.BLOCK * last),
                    rows=slice(layout.ROWS * step, layout.ROWS * last),
                    parameters=slice(offset, end),
                    thermal=phase.thermal,
                )
            )
            step, offset = last, end
        self.stages = tuple(kinds)
        self.steps = step
        self.variable_count = kinds[-1].variables.stop + layout.STATES
        self.row_count = kinds[-1].rows.stop
        self.parameter_count = offset
        self.step_parameters = [
            slice(start, start + kind.parameter_count)
            for kind in kinds
            for start in range(kind.parameters.start, kind.parameters.stop, kind.parameter_count)
        ]
        self.sample_times_s: FloatArray = np.concatenate(
            [
                start
                + (np.full(kind.samples, 0.5) if kind.thermal else quadrature(kind.samples)[0])
                * kind.step_s
                for kind in kinds
                for start in horizon.node_times_s[kind.steps]
            ]
        )
        self.motion_samples = sum(kind.samples * kind.count for kind in kinds if not kind.thermal)
        own, sampled = np.arange(layout.STEP_PARAMETERS), np.arange(layout.SAMPLE_PARAMETERS)
        self.step_places = np.array([place.start for place in self.step_parameters])
        self._step_slots = self.step_places[:, None] + own
        first_samples = [
            np.arange(place.start + layout.STEP_PARAMETERS, place.stop, layout.SAMPLE_PARAMETERS)
            for place in self.step_parameters
        ]
        self.sample_places = np.concatenate(first_samples)
        self._sample_slots = self.sample_places[:, None] + sampled

    def parameters(self, shared: FloatArray, steps: FloatArray, samples: FloatArray) -> FloatArray:
        """Pack the parameter vector.

        Args:
            shared: order of ``GlobalIndex``, then of the cost terms, shape (GLOBALS,).
            steps: order of ``StepIndex``, shape (N, STEP_PARAMETERS).
            samples: order of ``SampleIndex``, shape (samples, SAMPLE_PARAMETERS), at ``sample_times_s``.
        """
        vector = np.empty(self.parameter_count)
        vector[: layout.GLOBALS] = shared
        vector[self._step_slots] = steps
        vector[self._sample_slots] = samples
        return vector

    def split(self, variables: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Cut the variables into states, shape (N + 1, 6), and inputs, shape (N, 6); both are copies."""
        table = variables[: -layout.STATES].reshape(self.steps, layout.BLOCK)
        states = np.vstack([table[:, : layout.STATES], variables[-layout.STATES :]])
        return states, table[:, layout.STATES :].copy()

    def join(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """Pack states, shape (N + 1, 6), and inputs, shape (N, 6), into the variables."""
        return np.concatenate([np.hstack([states[:-1], inputs]).ravel(), states[-1]])

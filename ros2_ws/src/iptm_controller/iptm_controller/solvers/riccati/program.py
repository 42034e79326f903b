"""The functions that the interior-point method calls, for a whole horizon.

Stages are mapped and the recursions accumulated, so that code size does not depend on the horizon and
cost grows linearly with it; an iteration is two calls.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import BLOCK
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.recursion import LOWER, backward_step, forward_step
from iptm_controller.solvers.riccati.stage_system import StageSystem, common_structure

ITERATE = ("w", "lam", "s", "z")
PARTS = ("pull", "centring")
STEP = tuple(f"d{what}_{part}" for what in ITERATE for part in PARTS)
FRACTION_TO_BOUNDARY = 0.995
LEAST_DISTANCE = 1e-3


@dataclass(frozen=True)
class RiccatiProgram:
    """Functions of one horizon.

    The iterate is w (variables), lam (costates of x_1 ... x_N), s (distances to the limits) and z (their
    multipliers). A step is ``pull + mu centring`` for the barrier parameter mu.

    Attributes:
        start: ``(guess, p, mu, ease) -> (w, s, z, values)``; slacks are those of the guess, with an ease
            of 1 at least as large as its violations.
        direction: ``(w, p, lam, s, z, delta) -> (parts of the step, report)``; delta is added to the
            diagonal of the Hessian, ``report`` is in the order of ``report.Report``.
        advance: ``(w, p, lam, s, z, parts of the step, mu, shrink) -> (next iterate, values, length)``;
            ``values`` is in the order of ``search_filter.Values``.
    """

    start: ca.Function
    direction: ca.Function
    advance: ca.Function

    @property
    def functions(self) -> list[ca.Function]:
        """All of them, for the compiler."""
        return [self.start, self.direction, self.advance]


def build_program(problem: OptimalControlProblem) -> RiccatiProgram:
    """Write the functions of a problem down."""
    builder = _Builder(problem)
    return RiccatiProgram(builder.start(), builder.direction(), builder.advance())


class _Builder:
    def __init__(self, problem: OptimalControlProblem) -> None:
        self._problem = problem
        self._grid = problem.grid
        self._steps = self._grid.steps
        self._systems = [
            StageSystem(stage, problem.model.limits) for stage in problem.stage_expressions()
        ]
        self._structure = common_structure(self._systems)
        self._sides = self._systems[0].sides
        self._w = ca.MX.sym("w", self._grid.variable_count)
        self._p = ca.MX.sym("p", self._grid.parameter_count)
        self._lam = ca.MX.sym("lam", layout.STATES * self._steps)
        self._s = ca.MX.sym("s", self._sides * self._steps)
        self._z = ca.MX.sym("z", self._sides * self._steps)

    def start(self) -> ca.Function:
        """First iterate: multipliers from the barrier, slacks as the penalties would have them."""
        mu, ease = ca.MX.sym("mu"), ca.MX.sym("ease")
        prices = np.outer(astuple(self._problem.penalties), self._grid.horizon.step_lengths_s)
        table = ca.reshape(self._w[: BLOCK * self._steps], BLOCK, self._steps)
        hard = BLOCK - layout.SLACKS
        least = self._map(
            [system.least_slacks(f"slacks_{index}") for index, system in enumerate(self._systems)],
            self._w,
            [],
        )[0]
        # An idle slack is held off zero by its whole price: slack times price is the barrier.
        idle = mu / ca.MX(ca.DM(prices))
        slacks = ca.fmax(ca.fmax(table[hard:, :], ease * least), idle)
        raised = ca.vertcat(
            ca.vec(ca.vertcat(table[:hard, :], slacks)), self._w[BLOCK * self._steps :]
        )
        distances, defect, cost = self._values(raised)
        s = ca.vertcat(ca.fmax(distances[: -layout.SLACKS, :], LEAST_DISTANCE), slacks)
        return ca.Function(
            "start",
            [self._w, self._p, mu, ease],
            [raised, ca.vec(s), ca.vec(mu / s), _summary(distances, defect, cost, s)],
            ["guess", "p", "mu", "ease"],
            ["w", "s", "z", "values"],
        )

    def direction(self) -> ca.Function:
        """Newton step by one factorisation, in its two parts."""
        steps = self._steps
        delta = ca.MX.sym("delta")
        lam, s, z = (ca.reshape(part, -1, steps) for part in (self._lam, self._s, self._z))
        before = ca.horzcat(ca.MX.zeros(layout.STATES, 1), lam[:, :-1])
        functions = [
            system.linearise(self._structure, f"linearise_{index}")
            for index, system in enumerate(self._systems)
        ]
        dynamics, block, pull, centring, defect, slopes, gap, gradient, errors = self._map(
            functions, self._w, [before, lam, s, z]
        )
        zero = ca.MX.zeros(layout.STATES, 1)
        turned = [_reverse(matrix) for matrix in (dynamics, block, pull, centring, defect)]
        backward = backward_step(self._structure).mapaccum("backward", steps, 4)
        to_go, p_pull, p_centring, changed, feedback, k_pull, k_centring = (
            _reverse(matrix)
            for matrix in backward(
                ca.MX.zeros(LOWER.nnz(), 1), zero, zero, 0.0, *turned, ca.repmat(delta, 1, steps)
            )
        )
        after = [
            ca.horzcat(matrix[:, 1:], ca.MX.zeros(matrix.shape[0], 1))
            for matrix in (to_go, p_pull, p_centring)
        ]
        gains = (feedback, k_pull, k_centring)
        linear = (dynamics, defect, slopes, gap, s, z, lam)
        forward = forward_step(self._structure).mapaccum("forward", steps, 2)
        results = forward(zero, zero, *after, *gains, *linear)
        next_dx, du, dlam, ds, dz = (results[index : index + 2] for index in range(0, 10, 2))
        dw = [_interleave(*pair) for pair in zip(next_dx, du, strict=True)]
        # x_0 is given: nothing is asked of the gradient there.
        state_error = ca.horzcat(0.0, errors[0, 1:])
        report = ca.vertcat(
            ca.mmax(ca.horzcat(state_error, errors[1, :])),
            ca.mmax(errors[2, :]),
            ca.mmax(errors[3, :]),
            ca.mmax(errors[4, :]),
            ca.sum2(errors[5:8, :]),
            changed[0, 0],
            *(ca.dot(ca.vec(gradient), part[: BLOCK * steps]) for part in dw),
            *(ca.sum1(ca.vec(part / s)) for part in ds),
            1.0 / ca.fmax(1.0, ca.mmax(-ds[0] / s)),
            1.0 / ca.fmax(1.0, ca.mmax(-dz[0] / z)),
            ca.dot(s, dz[0]),
            ca.dot(z, ds[0]),
            ca.dot(ds[0], dz[0]),
        )
        outputs = [ca.vec(matrix) for pair in (dw, dlam, ds, dz) for matrix in pair]
        return ca.Function(
            "direction",
            [self._w, self._p, self._lam, self._s, self._z, delta],
            [*outputs, report],
            ["w", "p", "lam", "s", "z", "delta"],
            [*STEP, "report"],
        )

    def advance(self) -> ca.Function:
        """Take a step, as long as distances and multipliers permit times ``shrink``, and look there."""
        own = dict(zip(ITERATE, (self._w, self._lam, self._s, self._z), strict=True))
        parts = {
            f"d{name}_{part}": ca.MX.sym(f"d{name}_{part}", vector.numel())
            for name, vector in own.items()
            for part in PARTS
        }
        mu, shrink = ca.MX.sym("mu"), ca.MX.sym("shrink")
        step = {name: parts[f"d{name}_pull"] + mu * parts[f"d{name}_centring"] for name in own}
        nearest = ca.mmax(-step["s"] / self._s), ca.mmax(-step["z"] / self._z)
        primal, dual = (1.0 / ca.fmax(1.0, ratio / FRACTION_TO_BOUNDARY) for ratio in nearest)
        length = shrink * primal
        w = self._w + length * step["w"]
        distances, defect, cost = self._values(w)
        # A distance variable below the true distance costs merit for nothing.
        s = ca.fmax(ca.reshape(self._s + length * step["s"], -1, self._steps), distances)
        return ca.Function(
            "advance",
            [self._w, self._p, self._lam, self._s, self._z, *parts.values(), mu, shrink],
            [
                w,
                self._lam + length * step["lam"],
                ca.vec(s),
                self._z + dual * step["z"],
                _summary(distances, defect, cost, s),
                length,
            ],
            ["w", "p", "lam", "s", "z", *parts, "mu", "shrink"],
            [*(f"next_{name}" for name in ITERATE), "values", "length"],
        )

    def _map(self, functions: list[ca.Function], w: ca.MX, extra: list[ca.MX]) -> list[ca.MX]:
        """Evaluate one function per phase over its steps; results side by side."""
        arguments = self._grid.stage_arguments(w, self._p)
        successors = self._grid.next_states(w)
        pieces = []
        for function, kind, (x, u, p, shared) in zip(
            functions, self._grid.stages, arguments, strict=True
        ):
            more = [matrix[:, kind.steps] for matrix in extra]
            given = [x, u, successors[:, kind.steps], p, shared, *more]
            pieces.append(function.map(kind.count).call(given))
        return [ca.horzcat(*parts) for parts in zip(*pieces, strict=True)]

    def _values(self, w: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        functions = [
            system.evaluate(f"evaluate_{index}") for index, system in enumerate(self._systems)
        ]
        distances, defect, cost = self._map(functions, w, [])
        return distances, defect, ca.sum2(cost)


def _summary(distances: ca.MX, defect: ca.MX, cost: ca.MX, s: ca.MX) -> ca.MX:
    residual = ca.vertcat(ca.vec(defect), ca.vec(distances - s))
    logarithms = ca.sum1(ca.log(ca.vec(s)))
    return ca.vertcat(cost, logarithms, ca.norm_1(residual), ca.norm_inf(residual))


def _interleave(next_dx: ca.MX, du: ca.MX) -> ca.MX:
    """Steps of states and inputs in the order of the variables; x_0 does not move."""
    dx = ca.horzcat(ca.MX.zeros(layout.STATES, 1), next_dx[:, :-1])
    return ca.vertcat(ca.vec(ca.vertcat(dx, du)), next_dx[:, -1])


def _reverse(matrix: ca.MX) -> ca.MX:
    return matrix[:, ::-1]

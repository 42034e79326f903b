"""The functions that the interior-point method calls, for a whole horizon.

Stages are mapped and the recursions accumulated, so that code size does not depend on the horizon and
cost grows linearly with it; an iteration is two calls.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple
from typing import NamedTuple

import casadi as ca
import numpy as np
from studies.speed.transcription import next_states, stage_arguments
from tests.reference.line_search import FilterPoint, StepSummary

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import BLOCK
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.constants import FRACTION_TO_BOUNDARY, LEAST_SLACK
from iptm_controller.solvers.riccati.recursion import LOWER, PARTS, backward_step, forward_step
from iptm_controller.solvers.riccati.stage_system import StageSystem, common_sparsity
from iptm_core.physics.ops import named_function

ITERATE = ("w", "lam", "s", "z")
"""Variables of the problem, multipliers of the dynamics, slacks and multipliers of the inequalities."""
STEP = tuple(f"d{name}_{part}" for name in ITERATE for part in PARTS)


def build_program(problem: OptimalControlProblem) -> list[ca.Function]:
    """Return the functions of a problem; the iterate is ``ITERATE``, a Newton step ``STEP``.

    Returns:
        starting_point: ``(guess, p, mu, relax) -> (w, s, z, point)``; the slacks of soft limits are those
            of the guess, with ``relax`` of 1 at least as large as its violations.
        search_direction: ``(iterate, p, delta) -> (step, summary)``; delta is added to the diagonal of the
            Hessian, ``summary`` holds the fields of ``StepSummary``.
        trial_point: ``(iterate, p, step, mu, backtracking) -> (next iterate, point, length)``; ``point``
            holds the fields of ``FilterPoint``, ``length`` is the primal step length.
    """
    builder = _Builder(problem)
    return [builder.starting_point(), builder.search_direction(), builder.trial_point()]


class _Builder:
    def __init__(self, problem: OptimalControlProblem) -> None:
        self._penalties = problem.penalties
        self._grid = problem.grid
        self._steps = self._grid.steps
        self._systems = [StageSystem(stage) for stage in problem.stage_expressions()]
        self._sparsity = common_sparsity(self._systems)
        # Built once: whatever calls them then shares their code.
        self._evaluations = [
            system.evaluate(f"evaluate_{index}") for index, system in enumerate(self._systems)
        ]
        inequalities = self._systems[0].inequality_count * self._steps
        sizes = {
            "w": self._grid.variable_count,
            "lam": layout.STATES * self._steps,
            "s": inequalities,
            "z": inequalities,
        }
        self._iterate = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
        self._p = ca.MX.sym("p", self._grid.parameter_count)
        self._numbers = ca.MX(ca.DM(problem.numbers))

    def starting_point(self) -> ca.Function:
        """Return the first iterate: z from the barrier, soft slacks as their penalties would have them."""
        mu, relax, guess = ca.MX.sym("mu"), ca.MX.sym("relax"), self._iterate["w"]
        prices = np.outer(astuple(self._penalties), self._grid.horizon.step_lengths_s)
        table = ca.reshape(guess[: BLOCK * self._steps], BLOCK, self._steps)
        hard = BLOCK - layout.SLACKS
        least = self._map(
            [
                system.least_soft_slacks(f"slacks_{index}")
                for index, system in enumerate(self._systems)
            ],
            guess,
        )["soft_slacks"]
        # A soft slack that is not needed is held off zero by its whole price: slack times price is mu.
        idle = mu / ca.MX(ca.DM(prices))
        soft_slacks = ca.fmax(ca.fmax(table[hard:, :], relax * least), idle)
        w = ca.vertcat(
            ca.vec(ca.vertcat(table[:hard, :], soft_slacks)), guess[BLOCK * self._steps :]
        )
        inequalities, residual, cost = self._evaluate(w)
        s = ca.vertcat(ca.fmax(inequalities[: -layout.SLACKS, :], LEAST_SLACK), soft_slacks)
        return named_function(
            "starting_point",
            {"guess": guess, "p": self._p, "mu": mu, "relax": relax},
            {
                "w": w,
                "s": ca.vec(s),
                "z": ca.vec(mu / s),
                "point": _filter_point(inequalities, residual, cost, s),
            },
        )

    def search_direction(self) -> ca.Function:
        """Return the Newton step by one factorisation, in its two parts, with the norms at its start."""
        steps = self._steps
        delta = ca.MX.sym("delta")
        lam, s, z = (ca.reshape(self._iterate[name], -1, steps) for name in ("lam", "s", "z"))
        linear = self._map(
            [
                system.linearise(self._sparsity, f"linearise_{index}")
                for index, system in enumerate(self._systems)
            ],
            self._iterate["w"],
            lam=ca.horzcat(ca.MX.zeros(layout.STATES, 1), lam[:, :-1]),
            lam_next=lam,
            s=s,
            z=z,
        )
        zero = ca.MX.zeros(layout.STATES, 1)
        cost_to_go = ("P", "p_affine", "p_centring", "corrected")
        backward = backward_step(self._sparsity).mapaccum(
            "backward", steps, [f"{name}_next" for name in cost_to_go], list(cost_to_go)
        )
        stagewise = (
            "dynamics_jacobian",
            "hessian",
            "gradient_affine",
            "gradient_centring",
            "dynamics_residual",
        )
        feedback = backward(
            P_next=ca.MX.zeros(LOWER.nnz(), 1),
            p_affine_next=zero,
            p_centring_next=zero,
            corrected_next=0.0,
            delta=ca.repmat(delta, 1, steps),
            **{name: _reverse(linear[name]) for name in stagewise},
        )
        feedback = {name: _reverse(matrix) for name, matrix in feedback.items()}
        forward = forward_step(self._sparsity).mapaccum(
            "forward",
            steps,
            [f"dx_{part}" for part in PARTS],
            [f"dx_next_{part}" for part in PARTS],
        )
        moved = forward(
            **{f"dx_{part}": zero for part in PARTS},
            **{
                f"{name}_next": ca.horzcat(
                    feedback[name][:, 1:], ca.MX.zeros(feedback[name].shape[0], 1)
                )
                for name in ("P", "p_affine", "p_centring")
            },
            **{name: feedback[name] for name in ("K", "k_affine", "k_centring")},
            **{
                name: linear[name]
                for name in (
                    "dynamics_jacobian",
                    "dynamics_residual",
                    "inequality_jacobian",
                    "inequality_residual",
                )
            },
            s=s,
            z=z,
            lam=lam,
        )
        dw = {part: _interleave(moved[f"dx_next_{part}"], moved[f"du_{part}"]) for part in PARTS}
        dlam, ds, dz = (
            {part: moved[f"{name}_{part}"] for part in PARTS} for name in ("dlam", "ds", "dz")
        )
        # x_0 is given: nothing is asked of the gradient there.
        stationarity_x = ca.horzcat(0.0, linear["stationarity_x"][0, 1:])
        gradient = ca.vec(linear["cost_gradient"])
        summary = {
            "stationarity": ca.mmax(ca.horzcat(stationarity_x, linear["stationarity_u"])),
            "dynamics": ca.mmax(linear["dynamics_norm"]),
            "inequalities": ca.mmax(linear["inequality_norm"]),
            "complementarity": ca.mmax(linear["complementarity_norm"]),
            "complementarity_sum": ca.sum2(linear["complementarity_sum"]),
            "z_sum": ca.sum2(linear["z_sum"]),
            "lam_sum": ca.sum2(linear["lam_sum"]),
            "corrected_pivots": feedback["corrected"][0, 0],
            **{f"cost_slope_{part}": ca.dot(gradient, dw[part][: BLOCK * steps]) for part in PARTS},
            **{f"log_slope_{part}": ca.sum1(ca.vec(ds[part] / s)) for part in PARTS},
            "primal_step_affine": 1.0 / ca.fmax(1.0, ca.mmax(-ds["affine"] / s)),
            "dual_step_affine": 1.0 / ca.fmax(1.0, ca.mmax(-dz["affine"] / z)),
            "s_dz_affine": ca.dot(s, dz["affine"]),
            "z_ds_affine": ca.dot(z, ds["affine"]),
            "ds_dz_affine": ca.dot(ds["affine"], dz["affine"]),
        }
        step = {
            f"d{name}_{part}": ca.vec(parts[part])
            for name, parts in zip(ITERATE, (dw, dlam, ds, dz), strict=True)
            for part in PARTS
        }
        return named_function(
            "search_direction",
            {**self._iterate_arguments(), "delta": delta},
            {**step, "summary": _pack(StepSummary, summary)},
        )

    def trial_point(self) -> ca.Function:
        """Take a step to the fraction to the boundary times ``backtracking``, and evaluate there."""
        own = self._iterate
        parts = {
            f"d{name}_{part}": ca.MX.sym(f"d{name}_{part}", vector.numel())
            for name, vector in own.items()
            for part in PARTS
        }
        mu, backtracking = ca.MX.sym("mu"), ca.MX.sym("backtracking")
        step = {name: parts[f"d{name}_affine"] + mu * parts[f"d{name}_centring"] for name in own}
        # Fraction-to-the-boundary rule (Nocedal and Wright, eq. 19.9).
        primal, dual = (
            1.0 / ca.fmax(1.0, ca.mmax(-step[name] / own[name]) / FRACTION_TO_BOUNDARY)
            for name in ("s", "z")
        )
        length = backtracking * primal
        w = own["w"] + length * step["w"]
        inequalities, residual, cost = self._evaluate(w)
        # Slack reset: a slack below its constraint costs barrier objective and violation for nothing.
        s = ca.fmax(ca.reshape(own["s"] + length * step["s"], -1, self._steps), inequalities)
        return named_function(
            "trial_point",
            {**self._iterate_arguments(), **parts, "mu": mu, "backtracking": backtracking},
            {
                "next_w": w,
                "next_lam": own["lam"] + length * step["lam"],
                "next_s": ca.vec(s),
                "next_z": own["z"] + dual * step["z"],
                "point": _filter_point(inequalities, residual, cost, s),
                "length": length,
            },
        )

    def _iterate_arguments(self) -> dict[str, ca.MX]:
        own = self._iterate
        return {"w": own["w"], "p": self._p, "lam": own["lam"], "s": own["s"], "z": own["z"]}

    def _map(self, functions: list[ca.Function], w: ca.MX, **extra: ca.MX) -> dict[str, ca.MX]:
        """Evaluate one function per stage kind over its steps; results side by side."""
        arguments = stage_arguments(self._grid, w, self._p)
        following = next_states(self._grid, w)
        pieces = [
            function.map(kind.count)(
                x=x,
                u=u,
                x_next=following[:, kind.steps],
                p=p,
                g=shared,
                numbers=ca.repmat(self._numbers, 1, kind.count),
                **{name: matrix[:, kind.steps] for name, matrix in extra.items()},
            )
            for function, kind, (x, u, p, shared) in zip(
                functions, self._grid.stages, arguments, strict=True
            )
        ]
        return {name: ca.horzcat(*(piece[name] for piece in pieces)) for name in pieces[0]}

    def _evaluate(self, w: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Return inequality constraints and residual of the dynamics, one column per step, and the cost."""
        values = self._map(self._evaluations, w)
        return values["inequalities"], values["dynamics_residual"], ca.sum2(values["cost"])


def _filter_point(inequalities: ca.MX, residual: ca.MX, cost: ca.MX, s: ca.MX) -> ca.MX:
    violation = ca.vertcat(ca.vec(residual), ca.vec(inequalities - s))
    terms = {
        "cost": cost,
        "log_sum": ca.sum1(ca.log(ca.vec(s))),
        "violation": ca.norm_1(violation),
        "largest_violation": ca.norm_inf(violation),
    }
    return _pack(FilterPoint, terms)


def _pack(fields: type[NamedTuple], values: Mapping[str, ca.MX]) -> ca.MX:
    """Stack scalars in the order of the fields of the tuple that they are read into."""
    if set(values) != set(fields._fields):
        raise AssertionError(f"fields {sorted(values)} are not those of {fields.__name__}")
    return ca.vertcat(*(values[name] for name in fields._fields))


def _interleave(dx_next: ca.MX, du: ca.MX) -> ca.MX:
    """Return steps of states and inputs in the order of the variables; x_0 does not move."""
    dx = ca.horzcat(ca.MX.zeros(layout.STATES, 1), dx_next[:, :-1])
    return ca.vertcat(ca.vec(ca.vertcat(dx, du)), dx_next[:, -1])


def _reverse(matrix: ca.MX) -> ca.MX:
    return matrix[:, ::-1]

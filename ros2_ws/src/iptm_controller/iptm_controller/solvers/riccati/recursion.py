"""The Riccati recursion: backward over the stages for the feedback, forward for the Newton step.

The recursion solves the Newton system of an optimal control problem at a cost linear in the horizon (Rao,
Wright and Rawlings, 1998; Frison and Diehl, 2020). The cost to go of a stage is ``1/2 dx' P dx + p' dx`` with
``p = p_affine + mu p_centring``, the feedback ``du = K dx + k`` with k split alike. Inertia is corrected
on the way: pivots of the input block that are not safely positive are replaced by their absolute value or
a small positive number (modified Cholesky factorisation, Nocedal and Wright, section 3.4), so that the step
belongs to a convex problem and descends, without factorising again.
"""

from __future__ import annotations

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.solvers.riccati.stage_system import StageSparsity
from iptm_core.physics.ops import named_function

SMALLEST_PIVOT = 1e-6
LOWER = ca.Sparsity.lower(layout.STATES)
PARTS = ("affine", "centring")
"""Parts of a Newton step: ``affine + mu centring``. The first is the predictor of Mehrotra's method."""


def symmetric(lower: ca.SX) -> ca.SX:
    """Return the full matrix from its lower triangle."""
    return lower + ca.tril(lower, False).T  # noqa: FBT003 - CasADi takes it by position


def modified_cholesky(matrix: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return square-root-free Cholesky factors ``L D L'`` of a symmetric matrix made positive.

    Args:
        matrix: symmetric, shape (n, n).

    Returns:
        Unit lower triangle L, pivots D after the correction, and the number of corrected pivots.
    """
    size = matrix.shape[0]
    factor = ca.SX.eye(size)
    pivots: list[ca.SX] = []
    corrected = ca.SX(0.0)
    for column in range(size):
        pivot = matrix[column, column]
        for k in range(column):
            pivot -= factor[column, k] ** 2 * pivots[k]
        corrected += pivot < SMALLEST_PIVOT
        pivot = ca.fmax(ca.fabs(pivot), SMALLEST_PIVOT)
        pivots.append(pivot)
        for row in range(column + 1, size):
            entry = matrix[row, column]
            for k in range(column):
                entry -= factor[row, k] * factor[column, k] * pivots[k]
            factor[row, column] = entry / pivot
    return factor, ca.vertcat(*pivots), corrected


def cholesky_solve(factor: ca.SX, pivots: ca.SX, right: ca.SX) -> ca.SX:
    """Solve ``L D L' X = right`` for factors of ``modified_cholesky``."""
    size = factor.shape[0]
    rows = [right[row, :] for row in range(size)]
    for row in range(size):
        for k in range(row):
            rows[row] -= factor[row, k] * rows[k]
    rows = [row / pivots[index] for index, row in enumerate(rows)]
    for row in reversed(range(size)):
        for k in range(row + 1, size):
            rows[row] -= factor[k, row] * rows[k]
    return ca.vertcat(*rows)


def backward_step(sparsity: StageSparsity) -> ca.Function:
    """Return one stage of the backward recursion.

    ``delta`` is the multiple of the identity that regularises the Hessian (Waechter and Biegler, 2006,
    eq. 13). P is stored as the nonzeros of its lower triangle, K as a vector; ``corrected`` counts the
    corrected pivots of this and all later stages.

    Returns:
        Function of the cost to go of the next stage (P_next, p_..._next, corrected_next) and the results of
        ``linearise``, to the cost to go of this stage and its feedback.
    """
    lower = ca.SX.sym("P_next", LOWER)
    p_affine = ca.SX.sym("p_affine_next", layout.STATES)
    p_centring = ca.SX.sym("p_centring_next", layout.STATES)
    corrected_next = ca.SX.sym("corrected_next")
    dynamics = ca.SX.sym("dynamics_jacobian", sparsity.dynamics)
    hessian = ca.SX.sym("hessian", sparsity.hessian)
    gradient_affine = ca.SX.sym("gradient_affine", layout.BLOCK)
    gradient_centring = ca.SX.sym("gradient_centring", layout.BLOCK)
    residual = ca.SX.sym("dynamics_residual", layout.STATES)
    delta = ca.SX.sym("delta")

    cost_to_go = symmetric(lower)
    carried = ca.mtimes(cost_to_go, dynamics)
    # Only the lower triangle is ever used; the rest of the product never enters the code.
    total = (
        symmetric(hessian)
        + delta * ca.SX.eye(layout.BLOCK)
        + symmetric(ca.tril(ca.mtimes(dynamics.T, carried)))
    )
    total_affine = gradient_affine + ca.mtimes(
        dynamics.T, p_affine + ca.mtimes(cost_to_go, residual)
    )
    total_centring = gradient_centring + ca.mtimes(dynamics.T, p_centring)
    x, u = slice(0, layout.STATES), slice(layout.STATES, layout.BLOCK)
    factor, pivots, corrected = modified_cholesky(ca.densify(total[u, u]))
    cross = total[u, x]
    right = ca.horzcat(cross, total_affine[u], total_centring[u])
    gains = -cholesky_solve(factor, pivots, ca.densify(right))
    feedback = gains[:, : layout.STATES]
    k_affine, k_centring = gains[:, layout.STATES], gains[:, layout.STATES + 1]
    own = ca.tril(total[x, x] + ca.mtimes(cross.T, feedback))
    arguments = {
        "P_next": lower.nz[:],
        "p_affine_next": p_affine,
        "p_centring_next": p_centring,
        "corrected_next": corrected_next,
        "dynamics_jacobian": dynamics.nz[:],
        "hessian": hessian.nz[:],
        "gradient_affine": gradient_affine,
        "gradient_centring": gradient_centring,
        "dynamics_residual": residual,
        "delta": delta,
    }
    results = {
        "P": ca.project(own, LOWER).nz[:],
        "p_affine": ca.densify(total_affine[x] + ca.mtimes(cross.T, k_affine)),
        "p_centring": ca.densify(total_centring[x] + ca.mtimes(cross.T, k_centring)),
        "corrected": corrected_next + corrected,
        "K": ca.vec(ca.densify(feedback)),
        "k_affine": k_affine,
        "k_centring": k_centring,
    }
    return named_function("riccati_backward", arguments, results, cse=True)


def forward_step(sparsity: StageSparsity) -> ca.Function:
    """Return one stage of the forward recursion, for both parts of the step.

    Slacks and multipliers follow from the states and inputs: ``ds = J dw + (c - s)`` and
    ``dz = -Sigma ds - z + mu / s``.

    Returns:
        Function of dx_affine and dx_centring, the cost to go of the next stage, the feedback, the results of
        ``linearise`` and the iterate (lam belongs to the next state), to the parts of the step.
    """
    count = sparsity.inequalities.shape[0]
    dx = {part: ca.SX.sym(f"dx_{part}", layout.STATES) for part in PARTS}
    lower = ca.SX.sym("P_next", LOWER)
    p_next = {part: ca.SX.sym(f"p_{part}_next", layout.STATES) for part in PARTS}
    feedback = ca.SX.sym("K", layout.INPUTS, layout.STATES)
    k = {part: ca.SX.sym(f"k_{part}", layout.INPUTS) for part in PARTS}
    dynamics = ca.SX.sym("dynamics_jacobian", sparsity.dynamics)
    dynamics_residual = ca.SX.sym("dynamics_residual", layout.STATES)
    jacobian = ca.SX.sym("inequality_jacobian", sparsity.inequalities)
    inequality_residual, s, z = (
        ca.SX.sym(name, count) for name in ("inequality_residual", "s", "z")
    )
    lam = ca.SX.sym("lam", layout.STATES)

    cost_to_go = symmetric(lower)
    sigma = z / s
    dynamics_shift = {"affine": dynamics_residual, "centring": ca.SX.zeros(layout.STATES)}
    inequality_shift = {"affine": inequality_residual, "centring": ca.SX.zeros(count)}
    steps: dict[str, dict[str, ca.SX]] = {
        name: {} for name in ("dx_next", "du", "dlam", "ds", "dz")
    }
    for part in PARTS:
        du = ca.mtimes(feedback, dx[part]) + k[part]
        both = ca.vertcat(dx[part], du)
        dx_next = ca.mtimes(dynamics, both) + dynamics_shift[part]
        dlam = ca.mtimes(cost_to_go, dx_next) + p_next[part]
        ds = ca.mtimes(jacobian, both) + inequality_shift[part]
        dz = -sigma * ds
        if part == "affine":
            dlam -= lam
            dz -= z
        else:
            dz += 1.0 / s
        for name, value in zip(steps, (dx_next, du, dlam, ds, dz), strict=True):
            steps[name][part] = ca.densify(value)
    arguments = {
        **{f"dx_{part}": dx[part] for part in PARTS},
        "P_next": lower.nz[:],
        **{f"p_{part}_next": p_next[part] for part in PARTS},
        "K": ca.vec(feedback),
        **{f"k_{part}": k[part] for part in PARTS},
        "dynamics_jacobian": dynamics.nz[:],
        "dynamics_residual": dynamics_residual,
        "inequality_jacobian": jacobian.nz[:],
        "inequality_residual": inequality_residual,
        "s": s,
        "z": z,
        "lam": lam,
    }
    results = {
        f"{name}_{part}": value for name, parts in steps.items() for part, value in parts.items()
    }
    return named_function("riccati_forward", arguments, results, cse=True)

"""The Riccati recursion: backward over the stages for the feedback, forward for the step.

The cost to go of a stage is ``1/2 dx' P dx + (p_pull + mu p_centring)' dx``. Pivots of the input block
that are not safely positive are replaced by their absolute value or a small positive number: the step
then belongs to a convex problem and descends, without factorising again.
"""

from __future__ import annotations

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.solvers.riccati.stage_system import WIDTH, StageStructure

SMALLEST_PIVOT = 1e-6
LOWER = ca.Sparsity.lower(layout.STATES)


def symmetric(lower: ca.SX) -> ca.SX:
    """Full matrix from its lower triangle."""
    return lower + ca.tril(lower, False).T  # noqa: FBT003 - CasADi takes it by position


def modified_factor(matrix: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Square-root-free Cholesky factors ``L D L'`` of a symmetric matrix made positive.

    Args:
        matrix: symmetric, shape (n, n).

    Returns:
        Unit lower triangle L, pivots D after the change, and the number of changed pivots.
    """
    size = matrix.shape[0]
    factor = ca.SX.eye(size)
    pivots: list[ca.SX] = []
    changed = ca.SX(0.0)
    for column in range(size):
        pivot = matrix[column, column]
        for k in range(column):
            pivot -= factor[column, k] ** 2 * pivots[k]
        changed += pivot < SMALLEST_PIVOT
        pivot = ca.fmax(ca.fabs(pivot), SMALLEST_PIVOT)
        pivots.append(pivot)
        for row in range(column + 1, size):
            entry = matrix[row, column]
            for k in range(column):
                entry -= factor[row, k] * factor[column, k] * pivots[k]
            factor[row, column] = entry / pivot
    return factor, ca.vertcat(*pivots), changed


def substitute(factor: ca.SX, pivots: ca.SX, right: ca.SX) -> ca.SX:
    """Solve ``L D L' X = right`` for factors of ``modified_factor``."""
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


def backward_step(structure: StageStructure) -> ca.Function:
    """One stage backwards.

    Returns:
        ``(P, p_pull, p_centring, changed, dynamics, block, pull, centring, defect, delta) -> (P, p_pull,
        p_centring, changed, feedback, k_pull, k_centring)``; P as its lower triangle's nonzeros,
        feedback as a vector, ``changed`` counts changed pivots.
    """
    lower = ca.SX.sym("P", LOWER)
    slope_pull = ca.SX.sym("p_pull", layout.STATES)
    slope_centring = ca.SX.sym("p_centring", layout.STATES)
    before = ca.SX.sym("changed")
    dynamics = ca.SX.sym("dynamics", structure.dynamics)
    block = ca.SX.sym("block", structure.block)
    pull, centring = ca.SX.sym("pull", WIDTH), ca.SX.sym("centring", WIDTH)
    defect = ca.SX.sym("defect", layout.STATES)
    delta = ca.SX.sym("delta")

    to_go = symmetric(lower)
    carried = ca.mtimes(to_go, dynamics)
    # Only the lower triangle is ever used; the rest of the product never enters the code.
    total = (
        symmetric(block)
        + delta * ca.SX.eye(WIDTH)
        + symmetric(ca.tril(ca.mtimes(dynamics.T, carried)))
    )
    head_pull = pull + ca.mtimes(dynamics.T, slope_pull + ca.mtimes(to_go, defect))
    head_centring = centring + ca.mtimes(dynamics.T, slope_centring)
    x, u = slice(0, layout.STATES), slice(layout.STATES, WIDTH)
    factor, pivots, changed = modified_factor(ca.densify(total[u, u]))
    cross = total[u, x]
    right = ca.horzcat(cross, head_pull[u], head_centring[u])
    gains = -substitute(factor, pivots, ca.densify(right))
    feedback = gains[:, : layout.STATES]
    k_pull, k_centring = gains[:, layout.STATES], gains[:, layout.STATES + 1]
    next_lower = ca.tril(total[x, x] + ca.mtimes(cross.T, feedback))
    return ca.Function(
        "riccati_backward",
        [
            lower.nz[:],
            slope_pull,
            slope_centring,
            before,
            dynamics.nz[:],
            block.nz[:],
            pull,
            centring,
            defect,
            delta,
        ],
        [
            ca.project(next_lower, LOWER).nz[:],
            ca.densify(head_pull[x] + ca.mtimes(cross.T, k_pull)),
            ca.densify(head_centring[x] + ca.mtimes(cross.T, k_centring)),
            before + changed,
            ca.vec(ca.densify(feedback)),
            k_pull,
            k_centring,
        ],
        {"cse": True},
    )


def forward_step(structure: StageStructure) -> ca.Function:
    """One stage forwards, for both parts of the step.

    Returns:
        ``(dx_pull, dx_centring, P, p_pull, p_centring, feedback, k_pull, k_centring, dynamics, defect,
        slopes, gap, s, z, lam) -> (next dx_pull, next dx_centring, du_pull, du_centring, dlam_pull,
        dlam_centring, ds_pull, ds_centring, dz_pull, dz_centring)``. P and p belong to the cost to go
        after the stage, lam to the next state.
    """
    count = structure.distances.shape[0]
    starts = [ca.SX.sym(name, layout.STATES) for name in ("dx_pull", "dx_centring")]
    lower = ca.SX.sym("P", LOWER)
    slopes_to_go = [ca.SX.sym(name, layout.STATES) for name in ("p_pull", "p_centring")]
    feedback = ca.SX.sym("feedback", layout.INPUTS, layout.STATES)
    offsets = [ca.SX.sym(name, layout.INPUTS) for name in ("k_pull", "k_centring")]
    dynamics = ca.SX.sym("dynamics", structure.dynamics)
    defect = ca.SX.sym("defect", layout.STATES)
    slopes = ca.SX.sym("slopes", structure.distances)
    gap, distance, multiplier = (ca.SX.sym(name, count) for name in ("gap", "s", "z"))
    costate = ca.SX.sym("lam", layout.STATES)

    to_go = symmetric(lower)
    weight = multiplier / distance
    shifts = (defect, ca.SX.zeros(layout.STATES))
    gaps = (gap, ca.SX.zeros(count))
    results: list[list[ca.SX]] = [[], [], [], [], []]
    for part, start in enumerate(starts):
        inputs = ca.mtimes(feedback, start) + offsets[part]
        both = ca.vertcat(start, inputs)
        after = ca.mtimes(dynamics, both) + shifts[part]
        new_costate = ca.mtimes(to_go, after) + slopes_to_go[part]
        to_distance = ca.mtimes(slopes, both) + gaps[part]
        to_multiplier = -weight * to_distance
        if part == 0:
            new_costate -= costate
            to_multiplier -= multiplier
        else:
            to_multiplier += 1.0 / distance
        for result, value in zip(
            results, (after, inputs, new_costate, to_distance, to_multiplier), strict=True
        ):
            result.append(ca.densify(value))
    return ca.Function(
        "riccati_forward",
        [
            *starts,
            lower.nz[:],
            *slopes_to_go,
            ca.vec(feedback),
            *offsets,
            dynamics.nz[:],
            defect,
            slopes.nz[:],
            gap,
            distance,
            multiplier,
            costate,
        ],
        [value for result in results for value in result],
        {"cse": True},
    )

"""Sequential quadratic programming with structured and dense QP solvers, multipliers carried over.

The stage Hessians are made convex by clipping their eigenvalues. One iteration per tick is the
real-time iteration scheme.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iptm_controller.solvers.nlpsol_backend import Plugin

QP_SOLVERS: dict[str, dict[str, Any]] = {
    "piqp": {},
    "hpipm": {"hpipm": {"iter_max": 50}},
    "daqp": {},
}
"""Quadratic programming solvers by name, with their options."""


@dataclass(frozen=True)
class SequentialQuadraticOptions:
    """Settings of the SQP back ends.

    Attributes:
        dual_tolerance: tolerance on the gradient of the Lagrangian, scaled problem.
        primal_tolerance: tolerance on rows and bounds.
        smallest_eigenvalue: stage Hessians are lifted to this.
    """

    dual_tolerance: float = 1e-4
    primal_tolerance: float = 1e-6
    smallest_eigenvalue: float = 1e-6


def sqp_plugin(qp_solver: str, options: SequentialQuadraticOptions) -> Plugin:
    """CasADi's SQP method with one of ``QP_SOLVERS``."""

    def plugin_options(max_iterations: int) -> dict[str, Any]:
        return {
            "qpsol": qp_solver,
            "qpsol_options": {
                "error_on_fail": False,
                "print_time": False,
                **QP_SOLVERS[qp_solver],
            },
            "convexify_strategy": "eigen-clip",
            "convexify_margin": options.smallest_eigenvalue,
            "tol_du": options.dual_tolerance,
            "tol_pr": options.primal_tolerance,
            "max_iter": max_iterations,
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
        }

    signature = {
        "nlp_fg": ("f", "g"),
        "nlp_jac_fg": ("f", "grad_f_x", "g", "jac_g_x"),
        "nlp_hess_l": ("hess_gamma_x_x",),
    }
    return Plugin(
        f"sqp_{qp_solver}", "sqpmethod", signature, plugin_options, keeps_multipliers=True
    )

"""Interior-point plug-ins: Fatrop (structure-exploiting) and IPOPT (reference)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iptm_controller.ocp import layout
from iptm_controller.solvers.nlpsol_backend import Plugin


@dataclass(frozen=True)
class InteriorPointOptions:
    """Settings shared by the interior-point back ends.

    Attributes:
        tolerance: optimality tolerance on the scaled problem.
        initial_barrier: first barrier parameter; small, because the guess is a shifted solution.
        patience: iterations after which the Riccati method starts again with a large barrier, 0 to
            begin with it; the plug-ins do not know it.
    """

    tolerance: float = 1e-5
    initial_barrier: float = 1e-4
    patience: int = 20


def fatrop_plugin(steps: int, options: InteriorPointOptions) -> Plugin:
    """Fatrop with the stage structure of a horizon of ``steps`` steps."""

    def plugin_options(max_iterations: int) -> dict[str, Any]:
        return {
            "structure_detection": "manual",
            "N": steps,
            "nx": [layout.STATES] * (steps + 1),
            "nu": [layout.INPUTS] * steps + [0],
            "ng": [layout.LIMITS] * steps + [0],
            "equality": ([True] * layout.STATES + [False] * layout.LIMITS) * steps,
            "fatrop": {
                "print_level": 0,
                "tol": options.tolerance,
                "max_iter": max_iterations,
                "mu_init": options.initial_barrier,
            },
        }

    signature = {
        "nlp_f": ("f",),
        "nlp_g": ("g",),
        "nlp_grad_f": ("grad_f_x",),
        "nlp_jac_g": ("g", "jac_g_x"),
        "nlp_hess_l": ("grad_gamma_x", "hess_gamma_x_x"),
    }
    return Plugin("fatrop", "fatrop", signature, plugin_options)


def ipopt_plugin(steps: int, options: InteriorPointOptions) -> Plugin:
    """IPOPT with the same derivatives; it does not look at the stage structure."""
    del steps

    def plugin_options(max_iterations: int) -> dict[str, Any]:
        return {
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": options.tolerance,
                "max_iter": max_iterations,
                "mu_init": options.initial_barrier,
            }
        }

    signature = {
        "nlp_f": ("f",),
        "nlp_g": ("g",),
        "nlp_grad_f": ("f", "grad_f_x"),
        "nlp_jac_g": ("g", "jac_g_x"),
        "nlp_hess_l": ("triu_hess_gamma_x_x",),
    }
    return Plugin("ipopt", "ipopt", signature, plugin_options)

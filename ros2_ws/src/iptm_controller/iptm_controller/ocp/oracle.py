"""The functions of the nonlinear program that solvers look up by name in a compiled problem."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from iptm_controller.ocp.transcription import Transcription

OracleSignature = Mapping[str, tuple[str, ...]]
"""Function name to the names of its outputs, as a solver plug-in expects them."""

_COMMON: OracleSignature = {
    "nlp": ("f", "g"),
    "nlp_grad": ("f", "g", "grad_gamma_x", "grad_gamma_p"),
}
_DUAL_OUTPUTS = ("grad_gamma_x", "grad_gamma_p", "hess_gamma_x_x", "triu_hess_gamma_x_x")


def oracle_expressions(transcription: Transcription) -> dict[str, ca.MX]:
    """Return the problem as symbolic expressions, for solvers that differentiate by themselves."""
    return {
        "x": transcription.variables,
        "p": transcription.parameters,
        "f": transcription.cost,
        "g": transcription.rows,
    }


def oracle_functions(transcription: Transcription, signature: OracleSignature) -> list[ca.Function]:
    """Build the named functions of a plug-in from the stage-wise derivatives.

    Args:
        signature: what the plug-in looks up besides the problem itself.

    Returns:
        Functions of ``(x, p)``, or of ``(x, p, lam_f, lam_g)`` where an output needs multipliers.
    """
    w, p = transcription.variables, transcription.parameters
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", transcription.grid.row_count)
    gradient, jacobian = transcription.gradient, transcription.jacobian
    hessian = transcription.hessian(lam_f, lam_g)
    outputs = {
        "f": transcription.cost,
        "g": transcription.rows,
        "grad_f_x": gradient,
        "jac_g_x": jacobian,
        "grad_gamma_x": lam_f * gradient + ca.mtimes(jacobian.T, lam_g),
        # Sensitivity to parameters is not used; the slot only has to exist.
        "grad_gamma_p": ca.MX.zeros(p.numel()),
        "hess_gamma_x_x": hessian,
        "triu_hess_gamma_x_x": ca.triu(hessian),
    }
    functions = []
    for name, results in {**_COMMON, **signature}.items():
        dual = any(result in _DUAL_OUTPUTS for result in results)
        arguments = [w, p, lam_f, lam_g] if dual else [w, p]
        names = ["x", "p", "lam_f", "lam_g"] if dual else ["x", "p"]
        functions.append(
            ca.Function(name, arguments, [outputs[key] for key in results], names, list(results))
        )
    return functions

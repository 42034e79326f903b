"""Builds the solver of a horizon."""

from __future__ import annotations

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_core.parameters.model import ModelParameters

__all__ = ["SolverOptions", "build_plain_solver", "build_solver"]


def build_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SwitchingCheck:
    """Return a solver for a horizon that also looks for better switching, see ``SwitchingCheck``."""
    return SwitchingCheck(
        build_plain_solver(horizon, parameters, options), _problem(horizon, parameters, options)
    )


def build_plain_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> RiccatiBackend:
    """Return the solver without the check: stateless between solves, so that it can be shared."""
    return RiccatiBackend(_problem(horizon, parameters, options), options)


def _problem(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> OptimalControlProblem:
    smoothing = DEFAULT_SMOOTHING.scaled(options.smoothing_factor)
    return OptimalControlProblem(horizon, parameters, smoothing)

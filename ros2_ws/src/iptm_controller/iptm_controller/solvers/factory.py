"""Builds a solver back end by name."""

from __future__ import annotations

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.solvers.interface import IPOPT, RICCATI, SolverBackend, SolverOptions
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_core.errors import SolverSetupError
from iptm_core.parameters.model import ModelParameters

__all__ = ["SOLVER_NAMES", "SolverOptions", "build_plain_solver", "build_solver"]

SOLVER_NAMES = (RICCATI, IPOPT)


def build_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    """Return a solver for a horizon that also looks for better switching, see ``SwitchingCheck``."""
    return SwitchingCheck(
        build_plain_solver(horizon, parameters, options),
        _problem(horizon, parameters, options),
        compile_code=options.compile_code,
        warm_iterations=options.warm_start_iterations,
    )


def build_plain_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    """Return the solver without the check: stateless between solves, so that it can be shared."""
    problem = _problem(horizon, parameters, options)
    if options.name == RICCATI:
        return RiccatiBackend(problem, options)
    if options.name == IPOPT:
        # The oracle of the tests, and the solver of whole trips.
        from iptm_controller.solvers.ipopt_backend import IpoptBackend  # noqa: PLC0415

        return IpoptBackend(problem, options)
    raise SolverSetupError(f"solver is '{options.name}'; allowed: {', '.join(SOLVER_NAMES)}")


def _problem(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> OptimalControlProblem:
    smoothing = DEFAULT_SMOOTHING.scaled(options.smoothing_factor)
    return OptimalControlProblem(horizon, parameters, smoothing)

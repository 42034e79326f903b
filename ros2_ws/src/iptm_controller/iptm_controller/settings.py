"""Choices of the controller that scenarios, node parameters and studies share."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.solvers.factory import SOLVER_NAMES
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES
from iptm_core.declaration import Settings, parameter

_SOLVER = SolverOptions()


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """What the controller optimises, and how far ahead."""

    strategy: str = parameter(DEFAULT_STRATEGY, "cost terms and weights", choices=tuple(STRATEGIES))
    horizon: str = parameter(
        str(MULTI_HORIZON),
        "prediction grid, <steps>x<seconds> parts joined by +, thermal ones with a t behind",
    )
    solver: str = parameter(_SOLVER.name, "solver back end", choices=SOLVER_NAMES)


@dataclass(frozen=True)
class SolveSettings(Settings):
    """Effort of one solve."""

    max_iterations: int = parameter(
        _SOLVER.max_iterations, "iterations of one solve at most", "", 1, 10000
    )
    tolerance: float = parameter(
        _SOLVER.tolerance, "optimality tolerance of the scaled problem", "", 1e-10, 1.0
    )
    compile_code: bool = parameter(
        _SOLVER.compile_code,
        "compile the problem where a C compiler is found (cached between starts)",
    )

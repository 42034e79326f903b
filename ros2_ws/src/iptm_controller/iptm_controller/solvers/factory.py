"""Builds a solver back end by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.backend import SolverBackend
from iptm_controller.solvers.budget import SolveBudget
from iptm_controller.solvers.cooling_probe import CoolingProbe
from iptm_controller.solvers.interior_point import (
    InteriorPointOptions,
    fatrop_plugin,
    ipopt_plugin,
)
from iptm_controller.solvers.nlpsol_backend import NlpsolBackend, Plugin
from iptm_controller.solvers.riccati.backend import RICCATI, RiccatiBackend
from iptm_controller.solvers.sequential_quadratic import (
    QP_SOLVERS,
    SequentialQuadraticOptions,
    sqp_plugin,
)
from iptm_core.errors import SolverSetupError
from iptm_core.parameters.model import ModelParameters


@dataclass(frozen=True)
class SolverOptions:
    """Choice of a solver.

    Attributes:
        name: one of ``SOLVER_NAMES``.
        compile_code: generate and compile C where a compiler is found.
        budget: bounds on iterations and time.
        interior_point: settings of the interior-point back ends.
        sequential_quadratic: settings of the SQP back ends.
    """

    name: str = RICCATI
    compile_code: bool = True
    budget: SolveBudget = field(default_factory=SolveBudget)
    interior_point: InteriorPointOptions = field(default_factory=InteriorPointOptions)
    sequential_quadratic: SequentialQuadraticOptions = field(
        default_factory=SequentialQuadraticOptions
    )


def build_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    """Transcribe the horizon and set a solver up for it, with the probe of the cooling valley.

    Raises:
        SolverSetupError: unknown name, or the set-up fails.
    """
    return CoolingProbe(build_plain_solver(horizon, parameters, options), horizon, parameters)


def build_plain_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    """The solver without the probe: stateless between solves, so that it can be shared.

    Raises:
        SolverSetupError: unknown name, or the set-up fails.
    """
    problem = OptimalControlProblem(horizon, parameters)
    if options.name == RICCATI:
        return RiccatiBackend(
            problem,
            options.interior_point,
            options.budget,
            compile_code=options.compile_code,
        )
    try:
        plugin_of = _PLUGINS[options.name]
    except KeyError:
        raise SolverSetupError(
            f"solver '{options.name}' is unknown, allowed are {', '.join(SOLVER_NAMES)}"
        ) from None
    return NlpsolBackend(
        plugin_of(horizon.steps, options),
        problem,
        options.budget,
        compile_code=options.compile_code,
    )


def _fatrop(steps: int, options: SolverOptions) -> Plugin:
    return fatrop_plugin(steps, options.interior_point)


def _ipopt(steps: int, options: SolverOptions) -> Plugin:
    return ipopt_plugin(steps, options.interior_point)


def _sqp(qp_solver: str, steps: int, options: SolverOptions) -> Plugin:
    del steps
    return sqp_plugin(qp_solver, options.sequential_quadratic)


_PLUGINS: dict[str, Callable[[int, SolverOptions], Plugin]] = {
    "fatrop": _fatrop,
    "ipopt": _ipopt,
    **{f"sqp_{qp_solver}": partial(_sqp, qp_solver) for qp_solver in QP_SOLVERS},
}
SOLVER_NAMES = (RICCATI, *_PLUGINS)

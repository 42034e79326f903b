"""Builds a solver back end by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.transcription import Transcription, transcribe
from iptm_controller.solvers.backend import SolverBackend
from iptm_controller.solvers.cooling_probe import CoolingProbe
from iptm_controller.solvers.interior_point import InteriorPointBackend, InteriorPointOptions
from iptm_core.errors import SolverSetupError
from iptm_core.parameters.model import ModelParameters


@dataclass(frozen=True)
class SolverOptions:
    """Choice of a solver.

    Attributes:
        name: one of ``SOLVER_NAMES``.
        compile_code: generate and compile C where a compiler is found.
        interior_point: settings of the interior-point back ends.
    """

    name: str = "fatrop"
    compile_code: bool = True
    interior_point: InteriorPointOptions = field(default_factory=InteriorPointOptions)


def build_solver(
    horizon: Horizon, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    """Transcribe the horizon and set a solver up for it.

    Raises:
        SolverSetupError: unknown name, or the set-up fails.
    """
    try:
        build = _BUILDERS[options.name]
    except KeyError:
        raise SolverSetupError(
            f"solver '{options.name}' is unknown, allowed are {', '.join(SOLVER_NAMES)}"
        ) from None
    inner = build(transcribe(horizon, parameters), parameters, options)
    return CoolingProbe(inner, horizon, parameters)


def _interior_point(
    transcription: Transcription, parameters: ModelParameters, options: SolverOptions
) -> SolverBackend:
    return InteriorPointBackend(
        options.name,
        transcription,
        parameters.limits,
        options.interior_point,
        compile_code=options.compile_code,
    )


_BUILDERS: dict[str, Callable[[Transcription, ModelParameters, SolverOptions], SolverBackend]] = {
    "fatrop": _interior_point,
    "ipopt": _interior_point,
}
SOLVER_NAMES = tuple(_BUILDERS)

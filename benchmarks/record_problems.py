"""Records the optimal control problems of a headless closed loop: guess, parameters, initial state.

Up to the first tick asked for, the usual multi-horizon controller drives; then the grid asked for drives
itself, so that every guess is the shifted plan of its own previous tick.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.problem_sets import ProblemSet
from iptm_controller.controller import Controller, ControllerOptions, Decision, Measurements
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend, SolveResult, SolverOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.errors import IptmError
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop

PREVIEW_RESERVE_S = 30.0


class RecordingBackend:
    """Passes problems on and keeps a copy."""

    def __init__(self, inner: SolverBackend) -> None:
        self._inner = inner
        self.guesses: list[FloatArray] = []
        self.data: list[ProblemData] = []

    @property
    def name(self) -> str:
        """Name of the wrapped back end."""
        return self._inner.name

    @property
    def compiled(self) -> bool:
        """Whether the wrapped back end runs machine code."""
        return self._inner.compiled

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        self.guesses.append(guess.copy())
        self.data.append(data)
        return self._inner.solve(data, guess)


class _Relay:
    """Two controllers, one after the other."""

    def __init__(self, first: Controller, second: Controller, at_tick: int) -> None:
        self.options = second.options
        self._first, self._second = first, second
        self._at_tick = at_tick
        self._tick = 0

    def decide(self, measured: Measurements) -> Decision:
        controller = self._first if self._tick < self._at_tick else self._second
        self._tick += 1
        return controller.decide(measured)


def record_problems(
    cycle: str, strategy: str, horizon: str, first_tick: int = 0, count: int | None = None
) -> ProblemSet:
    """Drive a closed loop and keep its problems.

    Args:
        cycle: driving cycle of ``build_route``.
        strategy: name of the strategy.
        horizon: grid such as ``3x1+5x5``.
        first_tick: tick of the first problem kept.
        count: number of problems, None for all up to the end of the cycle.

    Returns:
        The problems; the first guess is that of a cold start.

    Raises:
        IptmError: a name is unknown or the problem cannot be set up.
    """
    parameters = load_parameters().values
    duration_s = None if count is None else float(first_tick + count)
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    grid = Horizon.parse(horizon)
    chosen = strategy_by_name(strategy)
    recorder = RecordingBackend(build_solver(grid, parameters, SolverOptions()))
    recorded = Controller(parameters, ControllerOptions(strategy=chosen, horizon=grid), recorder)
    lead_in = Controller(parameters, ControllerOptions(strategy=chosen, horizon=MULTI_HORIZON))
    preview = PreviewSettings(preview_length_s=max(60.0, grid.duration_s + PREVIEW_RESERVE_S))
    run_closed_loop(
        route,
        Plant(parameters, route.slope.slope_at),
        cast("Controller", _Relay(lead_in, recorded, first_tick)),
        preview,
    )
    return ProblemSet(
        cycle=cycle,
        strategy=strategy,
        horizon=str(grid),
        first_tick=first_tick,
        guesses=np.array(recorder.guesses),
        initial_states=np.array([data.initial_state for data in recorder.data]),
        parameters=np.array([data.parameters for data in recorder.data]),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Record one set; returns the exit code."""
    parser = argparse.ArgumentParser(prog="record_problems", description=__doc__)
    parser.add_argument("output", type=Path, help="archive to write (.npz)")
    parser.add_argument("--cycle", default="wltc_class3b", help="driving cycle (%(default)s)")
    parser.add_argument("--strategy", default="aging", help="strategy (%(default)s)")
    parser.add_argument("--horizon", default="3x1+5x5", help="grid (%(default)s)")
    parser.add_argument("--first-tick", type=int, default=0, help="first tick kept (%(default)s)")
    parser.add_argument("--count", type=int, help="problems to keep (default: to the end)")
    given = parser.parse_args(arguments)
    try:
        problems = record_problems(
            given.cycle, given.strategy, given.horizon, given.first_tick, given.count
        )
    except IptmError as error:
        print(f"record_problems: {error}", file=sys.stderr)
        return 2
    problems.save(given.output)
    print(f"{len(problems)} problems of {problems.cycle}, {problems.horizon}, kept")
    return 0


if __name__ == "__main__":
    sys.exit(main())

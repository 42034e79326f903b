"""Records the optimal control problems of a headless closed loop: guess, parameters, initial state.

Up to the first tick asked for, the usual multi-horizon controller drives; then the grid asked for drives
itself, so that every guess is the shifted plan of its own previous tick.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from benchmarks.harness import PROPOSED, closed_loop, run_benchmark
from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.data import ProblemData
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend, SolveResult, SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.errors import ScenarioError
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.physics.charge import nominal_charge_parameters
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray
from iptm_studies.closed_loop import run_closed_loop
from iptm_studies.run_spec import PREVIEW_RESERVE_S

FORMAT = 1


@dataclass(frozen=True)
class ProblemSet:
    """Consecutive problems of one closed loop.

    Attributes:
        cycle: driving cycle.
        strategy: name of the strategy.
        horizon: grid, such as ``3x1+5x5``.
        first_tick: tick of the first problem.
        guesses: shifted plans, scaled units, shape (n, variables).
        initial_states: shape (n, 6).
        parameters: shape (n, parameters).
    """

    cycle: str
    strategy: str
    horizon: str
    first_tick: int
    guesses: FloatArray
    initial_states: FloatArray
    parameters: FloatArray

    def __len__(self) -> int:
        return int(self.guesses.shape[0])

    def problem(self, index: int) -> tuple[ProblemData, FloatArray]:
        """Return data and guess of one problem."""
        data = ProblemData(self.initial_states[index], self.parameters[index])
        return data, self.guesses[index]

    def save(self, path: Path) -> None:
        """Write the set as a compressed archive."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            path,
            format=FORMAT,
            cycle=self.cycle,
            strategy=self.strategy,
            horizon=self.horizon,
            first_tick=self.first_tick,
            guesses=self.guesses,
            initial_states=self.initial_states,
            parameters=self.parameters,
        )

    @classmethod
    def load(cls, path: Path) -> ProblemSet:
        """Read a set.

        Raises:
            ScenarioError: the file cannot be read or is of another format.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                if int(archive["format"]) != FORMAT:
                    raise ScenarioError(
                        f"problem set '{path.name}' has format {int(archive['format'])}, "
                        f"allowed: {FORMAT}; record it again"
                    )
                return cls(
                    cycle=str(archive["cycle"]),
                    strategy=str(archive["strategy"]),
                    horizon=str(archive["horizon"]),
                    first_tick=int(archive["first_tick"]),
                    guesses=archive["guesses"],
                    initial_states=archive["initial_states"],
                    parameters=archive["parameters"],
                )
        except (OSError, ValueError, KeyError) as error:
            raise ScenarioError(f"problem set '{path.name}' cannot be read: {error}") from error


def spread_blocks(total: int, blocks: int, length: int) -> list[range]:
    """Return stretches of equal length, evenly spread over ``total`` problems.

    Args:
        total: number of problems.
        blocks: number of stretches.
        length: problems per stretch.

    Returns:
        The indices of each stretch, in order, never overlapping; as many as fit if more are asked for.
    """
    length = min(length, total)
    blocks = min(blocks, total // length)
    starts = np.linspace(0, total - length, blocks).astype(int)
    return [range(start, start + length) for start in starts.tolist()]


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

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        self.guesses.append(guess.copy())
        self.data.append(data)
        return self._inner.solve(data, guess, most_iterations=most_iterations)


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
    cycle: str,
    strategy: str,
    horizon: str,
    first_tick: int = 0,
    count: int | None = None,
    parameter_set: str = DEFAULT_SET,
) -> ProblemSet:
    """Drive a closed loop and keep its problems.

    Args:
        cycle: driving cycle of ``build_route``.
        strategy: name of the strategy.
        horizon: grid such as ``3x1+5x5``.
        first_tick: tick of the first problem kept.
        count: number of problems, None for all up to the end of the cycle.
        parameter_set: of vehicle and controller.

    Returns:
        The problems; the first guess is that of a cold start.

    Raises:
        IptmError: a name is unknown or the problem cannot be set up.
    """
    duration_s = None if count is None else float(first_tick + count)
    route, plant, lead_in = closed_loop(
        cycle, strategy=strategy, duration_s=duration_s, parameter_set=parameter_set
    )
    grid = Horizon.parse(horizon)
    parameters = nominal_charge_parameters(load_parameters(parameter_set).values)
    recorder = RecordingBackend(build_solver(grid, parameters, SolverOptions()))
    options = ControllerOptions(strategy=strategy_by_name(strategy), horizon=grid)
    recorded = Controller(parameters, options, recorder)
    preview = PreviewSettings(preview_length_s=max(60.0, grid.duration_s + PREVIEW_RESERVE_S))
    run_closed_loop(
        route,
        plant,
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


def measure(
    output: Path,
    cycle: str = "wltc_class3b",
    strategy: str = DEFAULT_STRATEGY,
    horizon: str = PROPOSED,
    first_tick: int = 0,
    count: int | None = None,
) -> dict[str, Any]:
    """Record one set and keep it in a file.

    Args:
        output: archive to write (.npz).
        cycle: driving cycle.
        strategy: strategy.
        horizon: grid.
        first_tick: first tick kept.
        count: problems to keep, to the end if not given.
    """
    problems = record_problems(cycle, strategy, horizon, first_tick, count)
    problems.save(output)
    return {"problems": len(problems), "cycle": cycle, "horizon": problems.horizon}


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))

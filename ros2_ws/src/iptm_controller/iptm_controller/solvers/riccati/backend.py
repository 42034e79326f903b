"""The Riccati interior-point method, in C (`iptm_controller/c`), on NumPy's memory.

A library holds the method and the stages of a shape; all horizons with these stage kinds use it, and so do
all models with these effects, whose numbers come with each call.
"""

from __future__ import annotations

import ctypes
import time
from dataclasses import astuple, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.c_sources import C_SOURCES
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import layout_header
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import (
    RICCATI,
    SolveResult,
    SolverOptions,
    Stopwatch,
    Termination,
    result_of,
)
from iptm_controller.solvers.riccati.stage_program import (
    HEADERS,
    SOLVER_SOURCES,
    stage_program,
)
from iptm_core.compilation import cache_directory, compile_sources
from iptm_core.errors import SolverSetupError
from iptm_core.physics.model_numbers import SplitFunctions
from iptm_core.state import FloatArray

CANDIDATES, LEVELS = 2, 2
PROGRAMS_KEPT = 32
"""Problems of a process whose code is not written anew for another solver."""
_TERMINATIONS = tuple(Termination)
_INT, _DOUBLE, _POINTER = ctypes.c_int, ctypes.c_double, ctypes.c_void_p


class _Horizon(ctypes.Structure):
    _fields_ = (
        ("steps", _INT),
        ("most_iterations", _INT),
        ("kind_steps", _POINTER),
        ("soft_prices", _POINTER),
        ("lengths_s", _POINTER),
        ("numbers", _POINTER),
    )


class _Options(ctypes.Structure):
    _fields_ = (
        ("tolerance", _DOUBLE),
        ("initial_barrier", _DOUBLE),
        ("until_s", _DOUBLE),
        ("clock_s", _POINTER),
        ("warm_start_iterations", _INT),
        ("max_iterations", _INT),
    )


class _Switching(ctypes.Structure):
    _fields_ = (
        ("candidates", _DOUBLE * CANDIDATES),
        ("rate_1_s", _DOUBLE),
        ("levels", _DOUBLE * LEVELS),
        ("try_every", _INT),
        ("simulates", _INT),
    )


class _Outcome(ctypes.Structure):
    _fields_ = (
        ("cost", _DOUBLE),
        ("log_sum", _DOUBLE),
        ("violation", _DOUBLE),
        ("largest_violation", _DOUBLE),
        ("termination", _INT),
        ("iterations", _INT),
        ("cold_starts", _INT),
    )


@dataclass(frozen=True)
class SwitchingNumbers:
    """What the check for better switching compares, see ``SwitchingCheck``; powers in scaled units."""

    candidates: tuple[float, float]
    rate_1_s: float
    levels: tuple[float, float]
    try_every: int
    simulates: bool


class RiccatiBackend:
    """Solves problem after problem, nothing carried over; see ``SolverBackend``. Serves one thread.

    Attributes:
        options: settings of the next solve; they may be exchanged in between.
    """

    name = RICCATI

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        """Compile the problem, or find it in the cache.

        Raises:
            SolverSetupError: no C compiler is installed, or the code cannot be compiled or loaded.
        """
        self.options = options
        self._library, functions = _library(problem.shape, cache_directory())
        self._numbers = functions.prepare(problem.numbers)
        grid = problem.grid
        self._kind_steps = np.array([kind.count for kind in grid.stages], dtype=np.intc)
        self._lengths_s = grid.horizon.step_lengths_s
        self._prices = np.outer(self._lengths_s, astuple(problem.penalties))
        self._horizon = _Horizon(
            grid.steps,
            0,
            self._kind_steps.ctypes.data,
            self._prices.ctypes.data,
            self._lengths_s.ctypes.data,
            self._numbers.ctypes.data,
        )
        self._options, self._outcome = _Options(), _Outcome()
        self._given: SolverOptions | None = None
        self._switching, self._since_second = _Switching(), _INT()
        self._parameters = np.empty(grid.parameter_count)
        self._guess = np.empty(grid.variable_count)
        self._variables = np.empty(grid.variable_count)
        self._costates = np.empty(layout.STATES * grid.steps)
        self._clock = ctypes.cast(self._library.iptm_monotonic_s, _POINTER).value
        self._work = np.empty(0)
        self._arguments: tuple[Any, ...] = ()
        self._compared: SwitchingNumbers | None = None
        given = self._horizon, self._options, self._switching, self._since_second
        self._given_pointers = tuple(map(ctypes.byref, given))

    def _prepare(self, data: ProblemData, guess: FloatArray, most: int | None) -> Stopwatch:
        clock, options = Stopwatch(), self.options
        if options is not self._given:
            self._use(options)
        bound = options.max_iterations
        self._options.max_iterations = bound if most is None else min(most, bound)
        if options.deadline_s:
            self._options.until_s = time.monotonic() + options.deadline_s
        self._guess[:] = guess
        self._guess[: layout.STATES] = data.initial_state
        self._parameters[:] = data.parameters
        return clock

    def _use(self, options: SolverOptions) -> None:
        self._given = options
        self._options.tolerance = options.tolerance
        self._options.initial_barrier = options.initial_barrier
        self._options.warm_start_iterations = options.warm_start_iterations
        self._options.clock_s = self._clock if options.deadline_s else None
        if options.max_iterations > self._horizon.most_iterations or not self._work.size:
            self._horizon.most_iterations = options.max_iterations
            size = self._library.iptm_checked_work_size(ctypes.byref(self._horizon))
            self._work = np.zeros(size)
        self._arguments = (
            self._parameters.ctypes.data,
            self._guess.ctypes.data,
            self._variables.ctypes.data,
            self._costates.ctypes.data,
            self._work.ctypes.data,
            ctypes.byref(self._outcome),
        )

    def _result(self, clock: Stopwatch, total_iterations: int | None = None) -> SolveResult:
        ended = self._outcome
        return result_of(
            _TERMINATIONS[ended.termination],
            ended.cost,
            ended.largest_violation,
            ended.iterations,
            clock,
            variables=self._variables.copy(),
            costates=self._costates.copy(),
            cold_starts=ended.cold_starts,
            total_iterations=total_iterations,
        )

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        clock = self._prepare(data, guess, most_iterations)
        solve = self._library.iptm_solve
        solve(ctypes.byref(self._horizon), ctypes.byref(self._options), *self._arguments)
        return self._result(clock)

    def solve_checked(
        self,
        data: ProblemData,
        guess: FloatArray,
        most_iterations: int | None,
        switching: SwitchingNumbers,
        since_second: int,
    ) -> tuple[SolveResult, int]:
        """Solve one problem, and again where another switching of the compressor may improve the plan.

        Returns:
            The better result with the iterations of both solves, and the solves since the last second one.
        """
        clock = self._prepare(data, guess, most_iterations)
        if switching is not self._compared:
            self._compared = switching
            self._switching.candidates[:] = switching.candidates
            self._switching.rate_1_s = switching.rate_1_s
            self._switching.levels[:] = switching.levels
            self._switching.try_every = switching.try_every
            self._switching.simulates = switching.simulates
        self._since_second.value = since_second
        parameters_and_guess, answers = self._arguments[:2], self._arguments[2:]
        *numbers, since = self._given_pointers
        solve = self._library.iptm_solve_checked
        iterations = solve(*numbers, *parameters_and_guess, since, *answers)
        return self._result(clock, iterations), self._since_second.value


@lru_cache(maxsize=PROGRAMS_KEPT)
def _library(shape: OptimalControlProblem, _folder: Path) -> tuple[ctypes.PyDLL, SplitFunctions]:
    """Return the library of a shape and the functions in it; the folder is part of the key only."""
    program = _stage_program(shape)
    files = {f"stages_{place}.c": text for place, text in enumerate(program.sources)}
    files |= C_SOURCES.read(*SOLVER_SOURCES, *HEADERS)
    path = compile_sources({**files, "layout.h": layout_header(), "stage_sizes.h": program.header})
    return _loaded(path), program.functions


_stage_program = lru_cache(maxsize=PROGRAMS_KEPT)(stage_program)


@lru_cache
def _loaded(path: Path) -> ctypes.PyDLL:
    try:
        # The interpreter lock is held: a solve is shorter than it takes to get the lock again.
        library = ctypes.PyDLL(str(path))
        library.iptm_checked_work_size.argtypes = [_POINTER]
        library.iptm_checked_work_size.restype = ctypes.c_size_t
        library.iptm_solve.argtypes = [_POINTER] * 8
        library.iptm_solve.restype = None
        library.iptm_solve_checked.argtypes = [_POINTER] * 10
        library.iptm_solve_checked.restype = _INT
    except (OSError, AttributeError) as error:
        raise SolverSetupError(f"solver '{RICCATI}' cannot be set up: {error}") from error
    return library

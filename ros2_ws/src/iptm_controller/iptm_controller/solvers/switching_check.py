"""A second start of the solver where switching the compressor on or off would improve a plan.

A compressor that is off cools nothing, and the gated chiller map is flat there: "off" and "on" are both
local minima, in every step of the horizon. Pontryagin's minimum principle separates them: with the
costates lam of the solution, the power of each step has to minimise the Hamiltonian

    H_k(P_cp) = stage cost + lam_k+1' F(x_k, u_k)

not only near the power found. If standstill or the most efficient power gives a much smaller value, the
problem is solved again from there, and the better plan is used. What the Hamiltonian cannot
see (how cooling down to the lower limit is best spread over the steps, driving that changes with the
cooling) is tried every few solves: one further solve at most each time.

On request other plans are simulated after every solve for which the Hamiltonian promises little, and the
solver begins again from one that is cheaper: with the same motion, it is not near the local minimum of the
present one. These plans cool from some part of the horizon on, or have one part of it switched over; a few
simulated steps each cost far less than one more solve. The code is ``c/switching.c``.
"""

from __future__ import annotations

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import SolveResult
from iptm_controller.solvers.riccati.backend import RiccatiBackend, SwitchingNumbers
from iptm_core.physics.thermal_loop import most_efficient_cooling
from iptm_core.state import FloatArray

USUAL_TEMPERATURE_K = 303.15
PROMISING_SHARE = 0.03
"""Expected gain, relative to the cost without slacks, at which a second solve is started at once."""
SECOND_ITERATIONS = 40
"""Largest number of iterations of a second solve; bounds the time of a tick."""
TRY_EVERY = 10
"""Interval, in solves, at which a second solve with a smaller expected gain is tried."""
SIMULATED_SHARES = (0.8, 1.3)
"""Powers of the simulated plans, relative to the most efficient one."""
DISTINCT_POWER_KW = 0.35
"""Difference in power (kW) from which a candidate is not in the basin of the plan's local minimum."""
LEAST_GAIN = 1e-4
"""Smallest difference in cost that makes a plan better."""
BLOCKS = 10
"""Most parts of the horizon that are switched as one."""
RUNNING_SHARE = 0.1
"""A compressor runs from this share of its most efficient power on."""
AT_LIMIT_K = 0.1
FULL_SHARE = 0.95
"""Of the most efficient power: from there on the work of a plan is not concentrated further."""
_TEMPERATURE_OFFSET_K = float(layout.STATE_OFFSET[StateIndex.CELL_1_TEMPERATURE])
_POWER_SCALE_W = float(layout.INPUT_SCALE[InputIndex.COMPRESSOR_POWER])


class SwitchingCheck:
    """Wraps the method; deterministic, because it counts solves and not seconds.

    Attributes:
        numbers: what it compares.
        since_second: solves since the last one with a second start, None before the first solve.
    """

    def __init__(
        self, inner: RiccatiBackend, problem: OptimalControlProblem, *, try_every: int = TRY_EVERY
    ) -> None:
        """Keep a method and what the check compares.

        Args:
            try_every: solves without a second one after which one is tried that promises little.
        """
        self._inner = inner
        limits = problem.model.limits
        power_w, _ = most_efficient_cooling(USUAL_TEMPERATURE_K, problem.model)
        off, on = limits.min_compressor_power_w / _POWER_SCALE_W, power_w / _POWER_SCALE_W
        most = limits.max_compressor_power_w / _POWER_SCALE_W
        low, high = (min(share * on, most) for share in SIMULATED_SHARES)
        self.numbers = SwitchingNumbers(
            (off, on),
            limits.max_compressor_rate_w_s / _POWER_SCALE_W,
            (low, high),
            try_every,
            inner.options.simulate_cooling,
        )
        self.since_second: int | None = None

    @property
    def name(self) -> str:
        """Name of the wrapped method."""
        return self._inner.name

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        since = self.numbers.try_every if self.since_second is None else self.since_second
        result, self.since_second = self._inner.solve_checked(
            data, guess, most_iterations, self.numbers, since
        )
        return result

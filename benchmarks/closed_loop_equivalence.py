"""Does the fast solver change what is driven? Closed loop with the default solver against a tight reference.

The reference is IPOPT at 1e-8; energies and capacity losses should agree within 0.1 %.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from benchmarks.harness import PROPOSED, closed_loop, run_benchmark
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.decision_record import SolveStatus
from iptm_core.metrics import FIGURES, compute_metrics, figure_values
from iptm_core.parameters import load_parameters
from iptm_studies.closed_loop import run_closed_loop

KEYS = (
    "cooling_energy",
    "traction_energy",
    "battery_energy",
    "cell_1_degradation",
    "cell_n_degradation",
)
SOLVERS = {
    "default": SolverOptions(),
    "reference": SolverOptions(name="ipopt", tolerance=1e-8),
}


def measure(
    cycle: str = "wltc_class3b",
    horizon: str = PROPOSED,
    strategy: str = DEFAULT_STRATEGY,
    duration_s: float | None = None,
) -> dict[str, Any]:
    """Drive the same trip with both solvers.

    Args:
        cycle: driving cycle.
        horizon: grid.
        strategy: strategy.
        duration_s: cut the trip, s.

    Raises:
        IptmError: a name is unknown or the set-up fails.
    """
    runs = {
        name: run_closed_loop(*closed_loop(cycle, horizon, strategy, solver, duration_s))
        for name, solver in SOLVERS.items()
    }
    parameters = load_parameters().values
    values = {
        name: figure_values(compute_metrics(run.trajectory, parameters))
        for name, run in runs.items()
    }
    rows: list[dict[str, Any]] = []
    for key in KEYS:
        default, reference = values["default"].get(key), values["reference"].get(key)
        change = None if default is None or not reference else default / reference - 1.0
        rows.append(
            {
                "key": key,
                "label": FIGURES[key].label,
                "unit": FIGURES[key].unit,
                "default": default,
                "reference": reference,
                "relative_change": change,
            }
        )
    first, second = runs["default"].trajectory, runs["reference"].trajectory
    return {
        "cycle": cycle,
        "horizon": horizon,
        "strategy": strategy,
        "ticks": len(runs["default"].decisions),
        "rows": rows,
        "largest_relative_change": max(abs(row["relative_change"] or 0.0) for row in rows),
        "largest_speed_difference_m_s": float(np.max(np.abs(first.speed_m_s - second.speed_m_s))),
        "unconverged": {
            name: int(np.count_nonzero(run.decisions.status != int(SolveStatus.SOLVED)))
            for name, run in runs.items()
        },
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))

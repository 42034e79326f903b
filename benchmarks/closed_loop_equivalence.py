"""Does the fast solver change what is driven? Closed loop with the default solver against a tight reference.

The reference is IPOPT at 1e-8; energies and capacity losses should agree within 0.1 %.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.report_files import run_benchmark
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import SolveStatus
from iptm_core.metrics import FIGURES, compute_metrics, figure_values
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop

KEYS = (
    "cooling_energy",
    "traction_energy",
    "battery_energy",
    "cell_1_degradation",
    "cell_n_degradation",
)
REFERENCE = SolverOptions(name="ipopt", tolerance=1e-8)


def measure(cycle: str, horizon: str, strategy: str, duration_s: float | None) -> dict[str, Any]:
    """Drive the same trip with both solvers.

    Raises:
        IptmError: a name is unknown or the set-up fails.
    """
    parameters = load_parameters().values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)

    def drive(solver: SolverOptions) -> ClosedLoopRun:
        options = ControllerOptions(
            strategy=strategy_by_name(strategy), horizon=Horizon.parse(horizon), solver=solver
        )
        plant = Plant(parameters, route.slope.slope_at)
        return run_closed_loop(route, plant, Controller(parameters, options))

    runs = {"default": drive(SolverOptions()), "reference": drive(REFERENCE)}
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
        "ticks": int(runs["default"].decisions.status.size),
        "rows": rows,
        "largest_relative_change": float(
            np.max(np.abs([row["relative_change"] or 0.0 for row in rows]))
        ),
        "largest_speed_difference_m_s": float(np.max(np.abs(first.speed_m_s - second.speed_m_s))),
        "unconverged": {
            name: int(np.count_nonzero(run.decisions.status != int(SolveStatus.SOLVED)))
            for name, run in runs.items()
        },
    }


OPTIONS = {
    "cycle": ("wltc_class3b", "driving cycle"),
    "horizon": ("3x1+5x5", "grid"),
    "strategy": ("aging", "strategy"),
    "duration_s": (None, "cut the trip, s"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; returns the exit code."""
    return run_benchmark("closed_loop_equivalence", __doc__, measure, OPTIONS, arguments)


if __name__ == "__main__":
    sys.exit(main())

"""Replays recorded problems through every back end and the peers, short stretch by stretch in turn.

A stretch is a few consecutive ticks: short enough that drift of the machine hits all contenders alike,
long enough that each runs with its own code and data in the caches, as it does in a closed loop (its
first problem is solved once more beforehand, unmeasured). All contenders take the same shifted guess;
SQP also carries its multipliers along. Ratios are taken within the run, on processor time. How optimal a
solution is, is judged by the controller's own derivatives, not by the solver's word.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.contenders import CONTENDER_NAMES, PEER, Contender, TimedSolve, build_contender
from benchmarks.harness import formatted_table, quantiles, run_benchmark
from benchmarks.kkt import KktChecker
from benchmarks.record_problems import ProblemSet, spread_blocks
from iptm_controller.horizon import Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_core.errors import SolverSetupError
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray

SAME_OPTIMUM = 1e-3


@dataclass
class _Series:
    outcomes: list[TimedSolve] = field(default_factory=list)
    residuals: list[float] = field(default_factory=list)


def compare(
    problems: ProblemSet,
    contenders: Sequence[str] = CONTENDER_NAMES,
    blocks: int = 10,
    block_length: int = 20,
    kkt_every: int = 5,
) -> list[dict[str, Any]]:
    """Replay a set.

    Args:
        problems: recorded problems.
        contenders: names.
        blocks: stretches of consecutive problems.
        block_length: problems per stretch.
        kkt_every: judge every n-th problem, 0 for none.

    Returns:
        One row of the table per contender, in the order asked for; times in ms, of the processor unless
        stated otherwise.

    Raises:
        IptmError: a contender is unknown or cannot be set up.
    """
    horizon, parameters = Horizon.parse(problems.horizon), load_parameters().values
    built = [build_contender(name, horizon, parameters) for name in contenders]
    checker = KktChecker(OptimalControlProblem(horizon, parameters))
    series = {contender.name: _Series() for contender in built}
    for block in spread_blocks(len(problems), blocks, block_length):
        for contender in built:
            outcomes = _take_turn(contender, problems, block)
            own = series[contender.name]
            own.outcomes.extend(outcomes)
            for index in range(0, len(outcomes), kkt_every) if kkt_every else ():
                if outcomes[index].converged:
                    data, _ = problems.problem(block[index])
                    own.residuals.append(_worst_residual(checker, data, outcomes[index]))
    return _summaries(series)


def _take_turn(contender: Contender, problems: ProblemSet, block: range) -> list[TimedSolve]:
    contender.solve(*problems.problem(block[0]))  # fills the caches
    contender.forget()
    return [contender.solve(*problems.problem(index)) for index in block]


def _worst_residual(checker: KktChecker, data: ProblemData, outcome: TimedSolve) -> float:
    try:
        return checker.residual(data, outcome.result.variables).worst
    except SolverSetupError:
        return math.inf


def _summaries(series: dict[str, _Series]) -> list[dict[str, Any]]:
    usable_costs = [
        [
            outcome.result.objective if outcome.result.status.usable else np.inf
            for outcome in own.outcomes
        ]
        for own in series.values()
    ]
    best = np.min(usable_costs, axis=0)
    peer = quantiles(_milliseconds(series[PEER].outcomes)) if PEER in series else {}
    summaries = []
    for name, own in series.items():
        outcomes = own.outcomes
        times = _milliseconds(outcomes)
        wall = 1e3 * np.array([outcome.elapsed.wall_s for outcome in outcomes])
        iterations = np.array([outcome.result.iterations for outcome in outcomes], dtype=float)
        objectives = np.array([outcome.result.objective for outcome in outcomes])
        residuals = np.array(own.residuals or [np.nan])
        excess = (objectives - best) / np.maximum(1.0, np.abs(best))
        ratios: dict[str, float | None] = {"median": None, "p99": None}
        if peer:
            ratios = {key: peer[key] / quantiles(times)[key] for key in ratios}
        summaries.append(
            {
                "name": name,
                "problems": len(outcomes),
                **{f"{key}_ms": value for key, value in quantiles(times).items()},
                **{f"wall_{key}_ms": value for key, value in quantiles(wall).items()},
                **{f"iterations_{key}": value for key, value in quantiles(iterations).items()},
                "unconverged": sum(not outcome.converged for outcome in outcomes),
                "unusable": sum(not outcome.result.status.usable for outcome in outcomes),
                "other_optimum": int(np.count_nonzero(~(excess <= SAME_OPTIMUM))),
                "kkt_median": float(np.median(residuals)),
                "kkt_max": float(np.max(residuals)),
                **{f"peer_by_{key}": ratio for key, ratio in ratios.items()},
            }
        )
    return summaries


def _milliseconds(outcomes: list[TimedSolve]) -> FloatArray:
    return 1e3 * np.array([outcome.elapsed.processor_s for outcome in outcomes])


def comparison_table(summaries: Sequence[Mapping[str, Any]]) -> str:
    """Return the Markdown table of a replay."""
    ratio = "{:.1f}".format
    rows = [
        {**row, "by_median": ratio(row["peer_by_median"]), "by_p99": ratio(row["peer_by_p99"])}
        if row["peer_by_median"]
        else {**row, "by_median": "", "by_p99": ""}
        for row in summaries
    ]
    return formatted_table(
        rows,
        {
            "solver": "`{name}`",
            "median ms:": "{median_ms:.2f}",
            "p99 ms:": "{p99_ms:.2f}",
            "max ms:": "{max_ms:.2f}",
            "wall median / p99 ms:": "{wall_median_ms:.2f} / {wall_p99_ms:.2f}",
            "iterations median / p99 / max:": "{iterations_median:.0f} / {iterations_p99:.0f} "
            "/ {iterations_max:.0f}",
            "not converged:": "{unconverged} of {problems}",
            "unusable:": "{unusable}",
            "other optimum:": "{other_optimum}",
            "KKT residual median / worst:": "{kkt_median:.0e} / {kkt_max:.0e}",
            "peer / solver, median:": "{by_median}",
            "at p99:": "{by_p99}",
        },
    )


def measure(
    problems: tuple[Path, ...],
    solver: tuple[str, ...] = CONTENDER_NAMES,
    blocks: int = 10,
    block_length: int = 20,
    kkt_every: int = 5,
) -> dict[str, list[dict[str, Any]]]:
    """Compare on recorded sets.

    Args:
        problems: recorded problems (.npz).
        solver: contender, repeatable.
        blocks: stretches of consecutive problems.
        block_length: problems per stretch.
        kkt_every: judge every n-th problem, 0 for none.

    Raises:
        IptmError: a file cannot be read, a contender is unknown or cannot be set up.
    """
    results = {}
    for path in problems:
        recorded = ProblemSet.load(path)
        title = f"{recorded.cycle}, {recorded.strategy}, {recorded.horizon}"
        results[title] = compare(recorded, solver, blocks, block_length, kkt_every)
    return results


def tables(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the tables of all sets, each below its title."""
    return "\n".join(f"\n{title}\n\n{comparison_table(rows)}" for title, rows in results.items())


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=tables))

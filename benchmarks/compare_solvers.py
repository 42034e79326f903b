"""Replays recorded problems through every back end and the peers, short stretch by stretch in turn.

A stretch is a few consecutive ticks: short enough that drift of the machine hits all contenders alike,
long enough that each runs with its own code and data in the caches, as it does in a closed loop (its
first problem is solved once more beforehand, unmeasured). All contenders take the same shifted guess;
SQP also carries its multipliers along. Ratios are taken within the run, on processor time. How optimal a
solution is, is judged by the controller's own derivatives, not by the solver's word.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.contenders import CONTENDER_NAMES, PEER, Contender, TimedSolve, build_contender
from benchmarks.kkt import KktChecker, KktResidual
from benchmarks.problem_sets import Block, ProblemSet, spread_blocks
from iptm_controller.horizon import Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_core.errors import IptmError, SolverSetupError
from iptm_core.parameters import load_parameters

SAME_OPTIMUM = 1e-3


@dataclass(frozen=True)
class Replay:
    """How a set is replayed.

    Attributes:
        contenders: names.
        blocks: stretches of consecutive problems.
        block_length: problems per stretch.
        kkt_every: judge every n-th problem, 0 for none.
    """

    contenders: tuple[str, ...] = CONTENDER_NAMES
    blocks: int = 10
    block_length: int = 20
    kkt_every: int = 5


@dataclass(frozen=True)
class ContenderSummary:
    """One row of the table; times in ms, of the processor unless said otherwise."""

    name: str
    problems: int
    median_ms: float
    p99_ms: float
    max_ms: float
    wall_median_ms: float
    wall_p99_ms: float
    iterations_median: float
    iterations_p99: float
    iterations_max: float
    unconverged: int
    unusable: int
    other_optimum: int
    kkt_median: float
    kkt_max: float
    peer_by_median: float | None
    peer_by_p99: float | None


@dataclass
class _Series:
    outcomes: list[TimedSolve] = field(default_factory=list)
    residuals: list[KktResidual] = field(default_factory=list)


def compare(problems: ProblemSet, replay: Replay) -> list[ContenderSummary]:
    """Replay a set.

    Args:
        problems: recorded problems.
        replay: contenders and extent.

    Returns:
        One summary per contender, in the order asked for.

    Raises:
        IptmError: a contender is unknown or cannot be set up.
    """
    horizon, parameters = Horizon.parse(problems.horizon), load_parameters().values
    contenders = [build_contender(name, horizon, parameters) for name in replay.contenders]
    checker = KktChecker(OptimalControlProblem(horizon, parameters))
    series = {contender.name: _Series() for contender in contenders}
    blocks = spread_blocks(len(problems), replay.blocks, replay.block_length)
    for block in blocks:
        turn = {contender.name: _take_turn(contender, problems, block) for contender in contenders}
        for name, outcomes in turn.items():
            series[name].outcomes.extend(outcomes)
            if replay.kkt_every:
                for index in range(0, len(outcomes), replay.kkt_every):
                    data, _ = problems.problem(block.start + index)
                    if outcomes[index].converged:
                        residual = _judge(checker, data, outcomes[index])
                        series[name].residuals.append(residual)
    return _summaries(series)


def _take_turn(contender: Contender, problems: ProblemSet, block: Block) -> list[TimedSolve]:
    contender.solve(*problems.problem(block.start))  # fills the caches
    contender.forget()
    return [contender.solve(*problems.problem(index)) for index in range(block.start, block.stop)]


def _judge(checker: KktChecker, data: ProblemData, outcome: TimedSolve) -> KktResidual:
    try:
        return checker.residual(data, outcome.result.variables)
    except SolverSetupError:
        return KktResidual(np.inf, np.inf, np.inf, 1.0)


def _summaries(series: dict[str, _Series]) -> list[ContenderSummary]:
    usable_costs = [
        [
            outcome.result.objective if outcome.result.status.usable else np.inf
            for outcome in own.outcomes
        ]
        for own in series.values()
    ]
    best = np.min(usable_costs, axis=0)
    peer = _milliseconds(series[PEER].outcomes) if PEER in series else None
    summaries = []
    for name, own in series.items():
        outcomes = own.outcomes
        times = _milliseconds(outcomes)
        wall = 1e3 * np.array([outcome.elapsed.wall_s for outcome in outcomes])
        iterations = np.array([outcome.result.iterations for outcome in outcomes], dtype=float)
        objectives = np.array([outcome.result.objective for outcome in outcomes])
        residuals = np.array([residual.worst for residual in own.residuals] or [np.nan])
        excess = (objectives - best) / np.maximum(1.0, np.abs(best))
        summaries.append(
            ContenderSummary(
                name=name,
                problems=len(outcomes),
                median_ms=float(np.median(times)),
                p99_ms=float(np.quantile(times, 0.99)),
                max_ms=float(times.max()),
                wall_median_ms=float(np.median(wall)),
                wall_p99_ms=float(np.quantile(wall, 0.99)),
                iterations_median=float(np.median(iterations)),
                iterations_p99=float(np.quantile(iterations, 0.99)),
                iterations_max=float(iterations.max()),
                unconverged=sum(not outcome.converged for outcome in outcomes),
                unusable=sum(not outcome.result.status.usable for outcome in outcomes),
                other_optimum=int(np.count_nonzero(~(excess <= SAME_OPTIMUM))),
                kkt_median=float(np.median(residuals)),
                kkt_max=float(np.max(residuals)),
                peer_by_median=None if peer is None else float(np.median(peer) / np.median(times)),
                peer_by_p99=None
                if peer is None
                else float(np.quantile(peer, 0.99) / np.quantile(times, 0.99)),
            )
        )
    return summaries


def _milliseconds(outcomes: list[TimedSolve]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return 1e3 * np.array([outcome.elapsed.processor_s for outcome in outcomes])


def table(summaries: Sequence[ContenderSummary]) -> str:
    """Return the Markdown table of a replay."""
    header = (
        "| solver | median ms | p99 ms | max ms | wall median / p99 ms | iterations median / p99 / max "
        "| not converged | unusable | other optimum | KKT residual median / worst "
        "| peer / solver, median | at p99 |"
    )
    lines = [header, "|---|" + "---:|" * 11]
    for s in summaries:
        by_median = "" if s.peer_by_median is None else f"{s.peer_by_median:.1f}"
        by_p99 = "" if s.peer_by_p99 is None else f"{s.peer_by_p99:.1f}"
        lines.append(
            f"| `{s.name}` | {s.median_ms:.2f} | {s.p99_ms:.2f} | {s.max_ms:.2f} "
            f"| {s.wall_median_ms:.2f} / {s.wall_p99_ms:.2f} "
            f"| {s.iterations_median:.0f} / {s.iterations_p99:.0f} / {s.iterations_max:.0f} "
            f"| {s.unconverged} of {s.problems} | {s.unusable} | {s.other_optimum} "
            f"| {s.kkt_median:.0e} / {s.kkt_max:.0e} | {by_median} | {by_p99} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare on recorded sets; returns the exit code."""
    parser = argparse.ArgumentParser(prog="compare_solvers", description=__doc__)
    usual = Replay()
    parser.add_argument("problems", type=Path, nargs="+", help="recorded problems (.npz)")
    parser.add_argument(
        "--solver", action="append", choices=CONTENDER_NAMES, help="contender; default: all"
    )
    parser.add_argument("--blocks", type=int, default=usual.blocks, help="(%(default)s)")
    parser.add_argument(
        "--block-length", type=int, default=usual.block_length, help="(%(default)s)"
    )
    parser.add_argument("--kkt-every", type=int, default=usual.kkt_every, help="(%(default)s)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = parser.parse_args(arguments)
    names = tuple(given.solver) if given.solver else CONTENDER_NAMES
    replay = Replay(names, given.blocks, given.block_length, given.kkt_every)
    results = {}
    try:
        for path in given.problems:
            problems = ProblemSet.load(path)
            summaries = compare(problems, replay)
            title = f"{problems.cycle}, {problems.strategy}, {problems.horizon}"
            print(f"\n{title}\n\n{table(summaries)}")
            results[title] = [asdict(summary) for summary in summaries]
    except IptmError as error:
        print(f"compare_solvers: {error}", file=sys.stderr)
        return 2
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(results, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

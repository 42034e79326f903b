"""The search: CMA-ES over the unknowns, cheap stages first, every run looked up before it is performed.

The optimiser gets a fixed seed and the same answers in the same order, so that a search that
is restarted repeats its path through the stored evaluations, then continues.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import cma
import numpy as np

from iptm.studies.execution import clock_text
from iptm.studies.workers import Failed, perform_all
from iptm_core.errors import IptmError
from iptm_core.state import FloatArray
from iptm_reproduction.identification.evaluations import (
    EvaluationTable,
    Figures,
    Task,
    evaluate,
    misfit,
    planned,
)
from iptm_reproduction.identification.unknowns import Candidate, Unknowns
from iptm_reproduction.names import STRATEGY_NAMES

SEED = 1
FAILED = 1e3
"""Score of a candidate whose runs lead nowhere."""
PRIOR_SHARE = 0.02
"""Loss of a candidate one standard deviation of the prior away in every number."""


@dataclass(frozen=True)
class Stage:
    """One stage of the search.

    Attributes:
        name: short name.
        strategies: what each candidate is driven with.
        generations: generations of the optimiser; 0 drives the best of the stage before.
        population: candidates of a generation, or of those driven.
        step: first step of the optimiser, in standard deviations of the prior.
    """

    name: str
    strategies: tuple[str, ...]
    generations: int
    population: int
    step: float = 1.0


STAGES = (
    Stage("reference", ("reference",), 1, 4, 0.4),
    Stage("pair", ("reference", "aging"), 2, 6, 0.4),
    Stage("table", tuple(STRATEGY_NAMES), 0, 2),
)
"""The reference alone fixes the absolute rows; the aging strategy most of the relative ones."""


@dataclass(frozen=True)
class Scored:
    """A candidate, its score (misfit and prior; `FAILED` where a run failed), and its runs by strategy."""

    candidate: Candidate
    score: float
    misfit: float
    runs: Mapping[str, Figures]


class Search:
    """A search over stages."""

    def __init__(
        self,
        unknowns: Unknowns,
        table: EvaluationTable,
        workers: int,
        report: Callable[..., None],
    ) -> None:
        """Prepare a search.

        Runs are looked up and kept in the table, and performed in a number of processes; ``report`` prints a
        line per stage (with a ``style``), run and candidate.
        """
        self._unknowns = unknowns
        self._table = table
        self._workers = workers
        self._report = report
        self._began = time.perf_counter()
        self._runs = 0

    def run(self, stages: Sequence[Stage] = STAGES) -> list[Scored]:
        """Go through the stages; returns the candidates of the last one, the best first."""
        center, best = self._unknowns.start, list[Scored]()
        for stage in stages:
            count = max(1, stage.generations) * stage.population + bool(stage.generations)
            runs = count * len(stage.strategies)
            self._report(f"stage {stage.name}: {count} candidates, {runs} runs", style="bold")
            if stage.generations:
                best = self._optimise(stage, center)
            else:
                chosen = [scored.candidate for scored in best[: stage.population]]
                best = _ranked(self._score(stage, chosen))
            center = self._unknowns.places(best[0].candidate.values)
        return best

    def _optimise(self, stage: Stage, center: FloatArray) -> list[Scored]:
        unknowns = self._unknowns
        options = {
            "bounds": [0.0, 1.0],
            "CMA_stds": list(unknowns.spreads),
            "popsize": stage.population,
            "seed": SEED,
            "verbose": -9,
        }
        strategy = cma.CMAEvolutionStrategy(list(center), stage.step, options)
        # The center itself is known before the first step away from it.
        every = self._score(stage, [unknowns.candidate(center)])
        for _ in range(stage.generations):
            asked = strategy.ask()
            candidates = [unknowns.candidate(np.asarray(x)) for x in asked]
            scored = self._score(stage, candidates, min(entry.score for entry in every))
            strategy.tell(asked, [entry.score for entry in scored])
            every += scored
        return _ranked(every)

    def _score(
        self, stage: Stage, candidates: Sequence[Candidate], best: float = np.inf
    ) -> list[Scored]:
        """Drive candidates with the strategies of a stage; ``best`` is the best score so far."""
        figures: list[dict[str, Figures]] = [{} for _ in candidates]
        waiting: dict[str, Task] = {}
        places: dict[str, list[tuple[int, str]]] = {}
        for place, candidate in enumerate(candidates):
            for name in stage.strategies:
                try:
                    inputs = planned(candidate, name)
                except IptmError:
                    continue  # numbers that contradict each other make no trip
                known = self._table.entries.get(inputs.key)
                if known is None:
                    waiting[inputs.key] = inputs, dict(candidate.values)
                    places.setdefault(inputs.key, []).append((place, name))
                else:
                    figures[place][name] = known.figures
        for _, found in perform_all(evaluate, list(waiting.values()), self._workers):
            if isinstance(found, Failed):
                continue
            self._table.add(found)
            self._runs += 1
            clock = clock_text(time.perf_counter() - self._began)
            self._report(f"[{self._runs}] {found.strategy}, {found.wall_s:.0f} s, at {clock}")
            for place, name in places[found.key]:
                figures[place][name] = found.figures
        scored = []
        for candidate, runs in zip(candidates, figures, strict=True):
            scored.append(self._scored(stage, candidate, runs))
            best = min(best, scored[-1].score)
            self._report(f"{stage.name}: {scored[-1].score:.3f}, best {best:.3f}")
        return scored

    def _scored(self, stage: Stage, candidate: Candidate, runs: Mapping[str, Figures]) -> Scored:
        if set(runs) != set(stage.strategies):
            return Scored(candidate, FAILED, FAILED, runs)
        fit = misfit(runs)
        unknowns = self._unknowns
        away = (unknowns.places(candidate.values) - unknowns.start) / unknowns.spreads
        return Scored(candidate, fit + PRIOR_SHARE * float(np.mean(away**2)), fit, runs)


def _ranked(scored: Iterable[Scored]) -> list[Scored]:
    """Return the candidates, each once, the best first."""
    different = {tuple(entry.candidate.values.items()): entry for entry in scored}
    return sorted(different.values(), key=lambda entry: entry.score)

"""The studies that were asked for as one set of runs: each run once, whoever needs it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.metrics import RunMetrics, figure_values
from iptm_studies.run_inputs import RunInputs, resolve_inputs, run_key
from iptm_studies.run_spec import RunSpec
from iptm_studies.study import Case, Selection, ShortTrip, Study
from iptm_studies.study_loading import load_study


@dataclass(frozen=True)
class PlannedRun:
    """A run to perform.

    Attributes:
        key: key of its result.
        inputs: everything it needs.
        address: the first case that asked for it, ``study/case``.
    """

    key: str
    inputs: RunInputs
    address: str


@dataclass(frozen=True)
class CaseState:
    """Where a case stands.

    Attributes:
        study: its study.
        case: the case.
        spec: its run; None while its strategy depends on runs that are not there.
        key: key of the run; None likewise.
        metrics: what the run achieved; None while it is not there.
        reason: why it is not there; empty if it is.
    """

    study: Study
    case: Case
    spec: RunSpec | None
    key: str | None
    metrics: RunMetrics | None
    reason: str

    @property
    def address(self) -> str:
        """``study/case``."""
        return self.study.address(self.case)


class Campaign:
    """Keeps the books: which runs are needed, done and failed, and which cases wait for others.

    Runs come out of ``take`` as soon as everything that they depend on is known.
    """

    def __init__(self, studies: Iterable[Study], others: Iterable[Study] = ()) -> None:
        """Plan studies.

        Args:
            studies: what was asked for.
            others: studies that those take their strategies from; only what is needed is planned.

        Raises:
            ScenarioError: a case cannot be run, or takes its strategy from nowhere.
        """
        self.studies = tuple(studies)
        known = {study.name: study for study in (*others, *self.studies)}
        self._runs: dict[str, PlannedRun] = {}
        self._new: list[str] = []
        self._metrics: dict[str, RunMetrics] = {}
        self._failures: dict[str, str] = {}
        self._candidates: dict[str, dict[str, RunSpec]] = {}
        self._keys: dict[str, str] = {}
        self._waiting: dict[str, Case] = {}
        self._hopeless: dict[str, str] = {}
        for study, case in self._cases():
            address = study.address(case)
            if case.best_of is None:
                self._keys[address] = self._plan(case.spec, address)
            else:
                self._candidates[address] = self._plan_candidates(case.best_of, known, address)
                self._check_base(case.spec, address)
                self._waiting[address] = case
        self._release()

    def take(self) -> tuple[PlannedRun, ...]:
        """Runs that have become known since the last call."""
        taken = tuple(self._runs[key] for key in self._new)
        self._new.clear()
        return taken

    def finish(self, key: str, metrics: RunMetrics) -> None:
        """Note that a run is there."""
        self._metrics[key] = metrics
        self._failures.pop(key, None)
        self._release()

    def fail(self, key: str, cause: str) -> None:
        """Note that a run failed."""
        self._failures[key] = cause
        self._release()

    @property
    def failures(self) -> Mapping[PlannedRun, str]:
        """Failed runs with their causes."""
        return {self._runs[key]: cause for key, cause in self._failures.items()}

    @property
    def hopeless(self) -> Mapping[str, str]:
        """Cases that can no longer be planned, by address, and why."""
        return self._hopeless

    @property
    def keys(self) -> frozenset[str]:
        """Keys of all runs planned so far."""
        return frozenset(self._runs)

    @property
    def unfinished(self) -> int:
        """Runs planned that neither are there nor failed."""
        return len(self._runs) - len(self._metrics) - len(self._failures)

    def run_estimates(self) -> dict[str, RunInputs]:
        """Runs that cases which wait for others are going to add, by address.

        The strategy in them is that of the first candidate. Cases that only repeat a run that is
        planned anyway, such as one of their candidates, add nothing and are left out.
        """
        estimates: dict[str, RunInputs] = {}
        known = set(self._runs)
        for address, case in self._waiting.items():
            first = next(iter(self._candidates[address].values()))
            inputs = resolve_inputs(case.spec.with_strategy(first.strategy))
            key = run_key(inputs)
            if key not in known:
                known.add(key)
                estimates[address] = inputs
        return estimates

    def cases(self) -> Iterator[CaseState]:
        """Every case of the studies that were asked for, in order."""
        for study, case in self._cases():
            address = study.address(case)
            key = self._keys.get(address)
            metrics = None if key is None else self._metrics.get(key)
            yield CaseState(
                study=study,
                case=case,
                spec=None if key is None else self._spec_of(case, address),
                key=key,
                metrics=metrics,
                reason="" if metrics is not None else self._why(address, key),
            )

    def _why(self, address: str, key: str | None) -> str:
        if key is None:
            return self._hopeless.get(address, "waits for the runs that its strategy depends on")
        return self._failures.get(key, "not computed")

    def _cases(self) -> Iterator[tuple[Study, Case]]:
        return ((study, case) for study in self.studies for case in study.cases)

    def _spec_of(self, case: Case, address: str) -> RunSpec:
        """The case's own run: of runs that several cases share, the labels may differ."""
        if case.best_of is None:
            return case.spec
        return self._runs[self._keys[address]].inputs.spec

    def _plan(self, spec: RunSpec, address: str) -> str:
        try:
            inputs = resolve_inputs(spec)
        except IptmError as error:
            raise ScenarioError(f"{address}: {error}") from error
        key = run_key(inputs)
        if key not in self._runs:
            self._runs[key] = PlannedRun(key, inputs, address)
            self._new.append(key)
        return key

    def _check_base(self, spec: RunSpec, address: str) -> None:
        """Find out now, not after hours, that a run cannot be set up."""
        try:
            resolve_inputs(spec)
        except IptmError as error:
            raise ScenarioError(f"{address}: {error}") from error

    def _plan_candidates(
        self, selection: Selection, known: Mapping[str, Study], address: str
    ) -> dict[str, RunSpec]:
        study = known.get(selection.study)
        if study is None:
            raise ScenarioError(
                f"{address}: takes its strategy from the unknown study {selection.study!r}"
            )
        candidates = [case for case in study.cases if selection.matches(case)]
        if not candidates or any(case.best_of is not None for case in candidates):
            raise ScenarioError(
                f"{address}: takes its strategy from cases of {study.name} with the labels "
                f"{dict(selection.labels)}; allowed are labels of cases that state their strategy"
            )
        return {self._plan(case.spec, study.address(case)): case.spec for case in candidates}

    def _release(self) -> None:
        """Plan the cases whose candidates have all come to an end."""
        for address, case in list(self._waiting.items()):
            candidates = self._candidates[address]
            ended = all(key in self._metrics or key in self._failures for key in candidates)
            if not ended or case.best_of is None:
                continue
            del self._waiting[address]
            best = self._best(candidates, case.best_of.lowest)
            if best is None:
                self._hopeless[address] = "every run that its strategy could come from failed"
                continue
            self._keys[address] = self._plan(
                case.spec.with_strategy(candidates[best].strategy), address
            )

    def _best(self, candidates: Mapping[str, RunSpec], lowest: str) -> str | None:
        ranked: list[tuple[bool, float, str]] = []
        for key in candidates:
            metrics = self._metrics.get(key)
            if metrics is None:
                continue
            values = figure_values(metrics)
            value = values.get(lowest)
            if value is None:
                raise ScenarioError(
                    f"runs have no figure {lowest!r} to choose a strategy by; "
                    f"allowed are {', '.join(values)}"
                )
            ranked.append((metrics.hard_violations > 0, value, key))
        return min(ranked)[2] if ranked else None


def plan_campaign(names: Iterable[str], small: ShortTrip | None = None) -> Campaign:
    """Load studies with those they depend on, and plan them.

    Args:
        names: shipped studies by name, or paths of study files.
        small: trip of the small version; None for the studies as they are.

    Raises:
        ScenarioError: a study cannot be read or planned.
    """
    studies = {study.name: study for study in (load_study(name) for name in names)}
    others: dict[str, Study] = {}
    for study in studies.values():
        for case in study.cases:
            if case.best_of is not None and case.best_of.study not in {*studies, *others}:
                others[case.best_of.study] = load_study(case.best_of.study)
    if small is not None:
        studies = {name: small.shorten(study) for name, study in studies.items()}
        others = {name: small.shorten(study) for name, study in others.items()}
    return Campaign(studies.values(), others.values())

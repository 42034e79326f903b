"""The studies that were asked for as one set of runs: each run once, also if several studies need it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace

from iptm.studies.run import Run
from iptm.studies.run_spec import RunKind, RunSpec
from iptm.studies.store import ResultStore
from iptm.studies.study import NOT_COMPUTED, SHORT_TRIP, Case, Selection, Study
from iptm.studies.study_loading import load_study
from iptm_controller.horizon import Horizon
from iptm_controller.strategy import Strategy
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.metrics import RunMetrics, figure_values

WAITS = "waits for the runs that its strategy depends on"
# Rough figures of one core; what earlier runs took corrects them.
_PER_TICK_S = 0.6e-3
_PER_TICK_AND_STEP_S = 0.17e-3
_PER_TICK_AND_SECOND_AHEAD_S = 0.006e-3
_WHOLE_TRIP_PER_TICK_S = 20e-3
_SETUP_S = 1.0


class ExpectedTimes:
    """A rough model of wall times that learns a factor per kind of run."""

    def __init__(self) -> None:
        self._taken: defaultdict[RunKind, float] = defaultdict(float)
        self._modelled: defaultdict[RunKind, float] = defaultdict(float)

    def learn(self, spec: RunSpec, ticks: int, taken_s: float) -> None:
        """Add the time that a run of `ticks` ticks took."""
        self._taken[spec.kind] += taken_s
        self._modelled[spec.kind] += modelled_s(spec, ticks)

    def of(self, inputs: Case) -> float:
        """Return the expected wall time of a run in seconds."""
        kind = inputs.spec.kind
        factor = self._taken[kind] / self._modelled[kind] if self._modelled[kind] > 0.0 else 1.0
        return factor * modelled_s(inputs.spec, inputs.ticks)


def modelled_s(spec: RunSpec, ticks: int) -> float:
    """Return the wall time of a run by its size alone, in seconds."""
    horizon = Horizon.parse(spec.horizon)
    per_tick = (
        _PER_TICK_S
        + _PER_TICK_AND_STEP_S * horizon.steps
        + _PER_TICK_AND_SECOND_AHEAD_S * horizon.duration_s
    )
    if spec.kind is RunKind.WHOLE_TRIP:
        per_tick += _WHOLE_TRIP_PER_TICK_S
    return _SETUP_S + ticks * per_tick


class Campaign:
    """The state of a set of studies: which runs are needed, done and failed, and which cases wait for others.

    Runs come out of ``take`` as soon as everything that they depend on is known.

    Attributes:
        studies: what was asked for.
        cases: every case of these studies, in order, kept up to date.
        expected: wall times.
        left_out: cases that can no longer be planned, by address, and why.
    """

    def __init__(self, studies: Iterable[Study], others: Iterable[Study] = ()) -> None:
        """Plan studies, and of others what they take their strategies from.

        Raises:
            ScenarioError: a case cannot be run, or takes its strategy from nowhere.
        """
        self.studies = tuple(studies)
        self.expected = ExpectedTimes()
        self.left_out: dict[str, str] = {}
        self._runs: dict[str, Case] = {}
        self._new: list[str] = []
        self._metrics: dict[str, RunMetrics] = {}
        self._failures: dict[str, str] = {}
        self._candidates: dict[str, dict[str, Strategy]] = {}
        known = {study.name: study for study in (*others, *self.studies)}
        self.cases = tuple(replace(case) for study in self.studies for case in study.cases)
        for case in self.cases:
            if case.best_of is None:
                self._plan(case)
                self._show(case)
            else:
                self._candidates[case.address] = self._plan_candidates(case, case.best_of, known)
                case.reason = WAITS
                # Find out now, not after hours, that the run cannot be set up.
                _checked(case)
        self._release()

    def cases_of(self, *studies: Study) -> list[Case]:
        """Return the cases of some of its studies, in order."""
        return [case for case in self.cases if case.study in {study.name for study in studies}]

    def take(self) -> tuple[Case, ...]:
        """Return the runs that have become known since the last call."""
        taken = tuple(self._runs[key] for key in self._new)
        self._new.clear()
        return taken

    def finish(self, run: Run) -> None:
        """Note that a run is there."""
        self._metrics[run.key] = run.metrics
        self._failures.pop(run.key, None)
        self.expected.learn(run.spec, run.ticks, run.wall_time_s)
        self._update(run.key)

    def fail(self, key: str, cause: str) -> None:
        """Note that a run failed."""
        self._failures[key] = cause
        self._update(key)

    @property
    def finished(self) -> int:
        """Number of runs that are there."""
        return len(self._metrics)

    @property
    def failures(self) -> Mapping[str, str]:
        """Causes of failed runs, by the address of the first case that asked for each."""
        return {self._runs[key].address: cause for key, cause in self._failures.items()}

    @property
    def keys(self) -> frozenset[str]:
        """Keys of all runs planned so far."""
        return frozenset(self._runs)

    def later_runs(self) -> tuple[Case, ...]:
        """Return the runs that cases which wait for others are going to add.

        The strategy in them is that of the first candidate. Cases that only repeat a run that is
        planned anyway, such as one of their candidates, add nothing and are left out.
        """
        later: dict[str, Case] = {}
        for case in self._waiting():
            first = next(iter(self._candidates[case.address].values()))
            run = _checked(replace(case, spec=case.spec.with_strategy(first), best_of=None))
            if run.key not in self._runs:
                later.setdefault(run.key, run)
        return tuple(later.values())

    def _waiting(self) -> list[Case]:
        return [
            case
            for case in self.cases
            if case.best_of is not None and case.address not in self.left_out
        ]

    def _show(self, case: Case) -> None:
        case.metrics = self._metrics.get(case.key)
        case.reason = "" if case.metrics else self._failures.get(case.key, NOT_COMPUTED)

    def _plan(self, case: Case) -> str:
        key = _checked(case).key
        if key not in self._runs:
            self._runs[key] = case
            self._new.append(key)
        return key

    def _plan_candidates(
        self, case: Case, selection: Selection, known: Mapping[str, Study]
    ) -> dict[str, Strategy]:
        """Plan the runs that a case may take its strategy from; returns their strategies by key."""
        takes = f"{case.address}: takes its strategy from"
        study = known.get(selection.study)
        if study is None:
            raise ScenarioError(f"{takes} the unknown study {selection.study!r}")
        candidates = [other for other in study.cases if selection.matches(other)]
        if not candidates or any(other.best_of is not None for other in candidates):
            raise ScenarioError(
                f"{takes} cases of {study.name} with the labels {dict(selection.labels)}; "
                "allowed: labels of cases that state their strategy"
            )
        return {self._plan(other): other.spec.strategy for other in candidates}

    def _update(self, key: str) -> None:
        """Show what became of a run, and plan the cases that only waited for it."""
        for case in self.cases:
            if case.best_of is None and case.key == key:
                self._show(case)
        self._release()

    def _release(self) -> None:
        ended = {*self._metrics, *self._failures}
        for case in self._waiting():
            candidates = self._candidates[case.address]
            if case.best_of is None or not ended.issuperset(candidates):
                continue
            best = self._best(candidates, case.best_of.lowest)
            if best is None:
                case.reason = "every run that its strategy could come from failed"
                self.left_out[case.address] = case.reason
            else:
                case.spec, case.best_of = case.spec.with_strategy(candidates[best]), None
                self._plan(case)
                self._show(case)

    def _best(self, candidates: Iterable[str], lowest: str) -> str | None:
        ranked: list[tuple[bool, float, str]] = []
        for key in self._metrics.keys() & set(candidates):
            metrics = self._metrics[key]
            values = figure_values(metrics)
            if lowest not in values:
                raise ScenarioError(
                    f"runs have no figure {lowest!r} to choose a strategy by; "
                    f"allowed: {', '.join(values)}"
                )
            ranked.append((metrics.hard_violations > 0, values[lowest], key))
        return min(ranked)[2] if ranked else None


def _checked(case: Case) -> Case:
    try:
        return case.check()
    except IptmError as error:
        raise ScenarioError(f"{case.address}: {error}") from error


def admit(campaign: Campaign, store: ResultStore) -> list[Case]:
    """Note which of the runs that have become known the store has; return the others."""
    missing: list[Case] = []
    while new := campaign.take():
        for case in new:
            run = store.find(case.key)
            if run is None:
                missing.append(case)
            else:
                campaign.finish(run)
    return missing


def survey(campaign: Campaign, store: ResultStore) -> list[Case]:
    """Compare a campaign with the store, without computing anything.

    A run that failed the last time is reported as failed, with its cause.

    Returns:
        The runs that the store lacks, failed ones included, the longest first.
    """
    lacking: list[Case] = []
    while new := admit(campaign, store):
        lacking += new
        for case in new:
            if cause := store.failure(case.key):
                campaign.fail(case.key, cause)
    return sorted(lacking, key=campaign.expected.of, reverse=True)


def plan_campaign(names: Iterable[str], short_s: float | None = None) -> Campaign:
    """Load studies (shipped ones by name, others by path) with those they depend on, and plan them.

    All drive ``short_s`` of the short trip in the small version; None for the studies as they are.

    Raises:
        ScenarioError: a study cannot be read or planned.
    """
    studies = {study.name: study for study in map(load_study, names)}
    needed = [case.best_of.study for one in studies.values() for case in one.cases if case.best_of]
    others = {name: load_study(name) for name in dict.fromkeys(needed) if name not in studies}
    groups = [list(group.values()) for group in (studies, others)]
    if short_s is not None:
        trip = {**SHORT_TRIP, "duration_s": short_s}
        groups = [[study.shortened(**trip) for study in group] for group in groups]
    return Campaign(*groups)

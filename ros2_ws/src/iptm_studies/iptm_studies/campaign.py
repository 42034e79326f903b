"""The studies that were asked for as one set of runs: each run once, also if several studies need it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from iptm_controller.horizon import Horizon
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.metrics import RunMetrics, figure_values
from iptm_studies.run import Run
from iptm_studies.run_inputs import RunInputs, resolve_inputs
from iptm_studies.run_spec import RunKind, RunSpec
from iptm_studies.study import Case, Selection, ShortTrip, Study
from iptm_studies.study_loading import load_study

NOT_COMPUTED = "not computed"
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

    def of(self, inputs: RunInputs) -> float:
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


@dataclass
class CaseState:
    """Where a case stands; its campaign keeps it up to date.

    Attributes:
        candidates: runs by key whose best one gives the case its strategy; empty if it states its own.
        spec: its run; None while its strategy depends on runs that are not there.
        key: key of the run; None without one.
        metrics: what the run achieved; None while it is not there.
        reason: why it is not there; empty if it is.
    """

    study: Study
    case: Case
    candidates: Mapping[str, RunSpec] = field(default_factory=dict)
    spec: RunSpec | None = None
    key: str | None = None
    metrics: RunMetrics | None = None
    reason: str = "waits for the runs that its strategy depends on"

    @property
    def address(self) -> str:
        """``study/case``."""
        return self.study.address(self.case)


class Campaign:
    """The state of a set of studies: which runs are needed, done and failed, and which cases wait for others.

    Runs come out of ``take`` as soon as everything that they depend on is known.

    Attributes:
        studies: what was asked for.
        cases: every case of these studies, in order.
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
        self._runs: dict[str, RunInputs] = {}
        self._new: list[str] = []
        self._metrics: dict[str, RunMetrics] = {}
        self._failures: dict[str, str] = {}
        known = {study.name: study for study in (*others, *self.studies)}
        self.cases = tuple(CaseState(study, case) for study in self.studies for case in study.cases)
        for state in self.cases:
            if state.case.best_of is None:
                self._assign(state, state.case.spec)
            else:
                state.candidates = self._plan_candidates(state, state.case.best_of, known)
                # Find out now, not after hours, that the run cannot be set up.
                _resolve(state.case.spec, state.address)
        self._release()

    def states(self, *studies: Study) -> list[CaseState]:
        """Return the cases of some of its studies."""
        return [state for state in self.cases if any(state.study is each for each in studies)]

    def take(self) -> tuple[RunInputs, ...]:
        """Return the runs that have become known since the last call."""
        taken = tuple(self._runs[key] for key in self._new)
        self._new.clear()
        return taken

    def finish(self, run: Run) -> None:
        """Note that a run is there."""
        self._metrics[run.key] = run.metrics
        self._failures.pop(run.key, None)
        self.expected.learn(run.spec, run.ticks, run.record.wall_time_s)
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

    def later_runs(self) -> tuple[RunInputs, ...]:
        """Return the runs that cases which wait for others are going to add.

        The strategy in them is that of the first candidate. Cases that only repeat a run that is
        planned anyway, such as one of their candidates, add nothing and are left out.
        """
        later: dict[str, RunInputs] = {}
        for state in self._waiting():
            first = next(iter(state.candidates.values()))
            inputs = _resolve(state.case.spec.with_strategy(first.strategy), state.address)
            if inputs.key not in self._runs:
                later.setdefault(inputs.key, inputs)
        return tuple(later.values())

    def _waiting(self) -> list[CaseState]:
        return [
            state
            for state in self.cases
            if state.key is None and state.address not in self.left_out
        ]

    def _assign(self, state: CaseState, spec: RunSpec) -> None:
        state.spec = spec
        state.key = self._plan(spec, state.address)
        self._show(state)

    def _show(self, state: CaseState) -> None:
        key = str(state.key)
        state.metrics = self._metrics.get(key)
        state.reason = "" if state.metrics else self._failures.get(key, NOT_COMPUTED)

    def _plan(self, spec: RunSpec, address: str) -> str:
        inputs = _resolve(spec, address)
        if inputs.key not in self._runs:
            self._runs[inputs.key] = inputs
            self._new.append(inputs.key)
        return inputs.key

    def _plan_candidates(
        self, state: CaseState, selection: Selection, known: Mapping[str, Study]
    ) -> dict[str, RunSpec]:
        takes = f"{state.address}: takes its strategy from"
        study = known.get(selection.study)
        if study is None:
            raise ScenarioError(f"{takes} the unknown study {selection.study!r}")
        candidates = [case for case in study.cases if selection.matches(case)]
        if not candidates or any(case.best_of is not None for case in candidates):
            raise ScenarioError(
                f"{takes} cases of {study.name} with the labels {dict(selection.labels)}; "
                "allowed: labels of cases that state their strategy"
            )
        return {self._plan(case.spec, study.address(case)): case.spec for case in candidates}

    def _update(self, key: str) -> None:
        """Show what became of a run, and plan the cases that only waited for it."""
        for state in self.cases:
            if state.key == key:
                self._show(state)
        self._release()

    def _release(self) -> None:
        ended = {*self._metrics, *self._failures}
        for state in self._waiting():
            if state.case.best_of is None or not ended.issuperset(state.candidates):
                continue
            best = self._best(state.candidates, state.case.best_of.lowest)
            if best is None:
                state.reason = "every run that its strategy could come from failed"
                self.left_out[state.address] = state.reason
            else:
                self._assign(state, state.case.spec.with_strategy(state.candidates[best].strategy))

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


def _resolve(spec: RunSpec, address: str) -> RunInputs:
    try:
        return resolve_inputs(spec, address)
    except IptmError as error:
        raise ScenarioError(f"{address}: {error}") from error


def plan_campaign(names: Iterable[str], small: ShortTrip | None = None) -> Campaign:
    """Load studies (shipped ones by name, others by path) with those they depend on, and plan them.

    Args:
        names: of the studies.
        small: trip of the small version; None for the studies as they are.

    Raises:
        ScenarioError: a study cannot be read or planned.
    """
    studies = {study.name: study for study in map(load_study, names)}
    needed = [case.best_of.study for one in studies.values() for case in one.cases if case.best_of]
    others = {name: load_study(name) for name in dict.fromkeys(needed) if name not in studies}
    groups = [list(group.values()) for group in (studies, others)]
    if small is not None:
        groups = [[small.shorten(study) for study in group] for group in groups]
    return Campaign(*groups)

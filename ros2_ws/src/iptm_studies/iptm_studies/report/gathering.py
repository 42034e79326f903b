"""From a surveyed campaign and its store to the runs that the report speaks about."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from iptm_core.errors import ScenarioError
from iptm_core.trajectory import Trajectory
from iptm_studies.campaign import Campaign, CaseState
from iptm_studies.report.measures import measures_of
from iptm_studies.report.runs import Gap, ReportRun, Results
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import RunKind
from iptm_studies.store import ResultStore
from iptm_studies.stored_run import RunRecord
from iptm_studies.study import SMALL

COMMAND = "scripts/reproduce run"
_CYCLE = "comprehensive"


@dataclass(frozen=True)
class Provenance:
    """Where the results come from.

    Attributes:
        trip: what the runs of the tables drive, in words.
        whole_cycle: whether that is the whole comprehensive cycle, as in the paper.
        runs: number of different runs.
        cases: number of cases that they stand for.
        revisions: number of runs by commit of the source.
        versions: number of runs by version, for interpreter and libraries.
        first_utc: end of the oldest run.
        last_utc: end of the newest run.
        interpreted: runs whose problem was not compiled, which makes them slower.
        wall_h: wall time of all runs together, in hours.
    """

    trip: str
    whole_cycle: bool
    runs: int
    cases: int
    revisions: dict[str, int]
    versions: dict[str, dict[str, int]]
    first_utc: str
    last_utc: str
    interpreted: int
    wall_h: float


@dataclass(frozen=True)
class Gathered:
    """What there is to report.

    Attributes:
        results: the runs, and why others are missing.
        provenance: where they come from.
        command: what computes a study, without its name.
    """

    results: Results
    provenance: Provenance
    command: str


def gather(store: ResultStore, campaign: Campaign) -> Gathered:
    """Collect the cases of a campaign.

    Args:
        store: where the runs are.
        campaign: studies that were compared with the store (``execution.survey``).

    Returns:
        Its runs; a missing one is a gap with its reason.

    Raises:
        ScenarioError: not a single run is there; says how many are missing and how to compute them.
        StoreError: a run has disappeared from the store since the survey.
    """
    states = list(campaign.cases())
    runs = [_run(store, state) for state in states if state.metrics is not None]
    gaps = [
        Gap(state.address, state.study.name, state.reason)
        for state in states
        if state.metrics is None
    ]
    if not runs:
        missing = Counter(gap.study for gap in gaps)
        raise ScenarioError(
            f"store {store.folder} holds none of the results that the report is made of; missing are "
            f"{', '.join(f'{count} runs of {study}' for study, count in missing.items())}. "
            f"Compute them with: {_command(campaign)} {' '.join(missing)}"
        )
    keys = {state.key for state in states if state.metrics is not None and state.key is not None}
    records = [store.load(key).record for key in sorted(keys)]
    trips = Counter(
        f"{state.spec.cycle}, slope {state.spec.slope}, {_length(state)}"
        for state in states
        if state.spec is not None and state.metrics is not None
    )
    return Gathered(
        Results(runs, gaps),
        _provenance(
            trips.most_common(1)[0][0],
            all(_drives_whole_cycle(state) for state in states if state.metrics is not None),
            len(runs),
            records,
        ),
        _command(campaign),
    )


def _command(campaign: Campaign) -> str:
    """What computes a study of this campaign, without its name."""
    specs = [case.spec for study in campaign.studies for case in study.cases]
    small = all(
        (spec.cycle, spec.slope, spec.duration_s) == (SMALL.cycle, SMALL.slope, SMALL.duration_s)
        for spec in specs
    )
    return f"{COMMAND} --small" if small else COMMAND


def _length(state: CaseState) -> str:
    assert state.metrics is not None  # noqa: S101 - only asked for finished cases
    return f"{state.metrics.duration_s:.0f} s"


def _run(store: ResultStore, state: CaseState) -> ReportRun:
    assert state.spec is not None  # noqa: S101 - a finished case has a run
    assert state.key is not None  # noqa: S101
    assert state.metrics is not None  # noqa: S101
    inputs = resolve_inputs(state.spec)
    key = state.key

    def load() -> Trajectory:
        return store.load(key).trajectory

    return ReportRun(
        address=state.address,
        measures=measures_of(state.metrics),
        parameters=inputs.parameters,
        route=inputs.route,
        strategy=state.spec.strategy,
        load=load,
        whole_trip=store.load(key).whole_trip if state.spec.kind is RunKind.WHOLE_TRIP else None,
    )


def _drives_whole_cycle(state: CaseState) -> bool:
    spec = state.spec
    return spec is not None and spec.cycle == _CYCLE and spec.duration_s is None


def _provenance(
    trip: str,
    whole_cycle: bool,  # noqa: FBT001
    cases: int,
    records: list[RunRecord],
) -> Provenance:
    names = dict.fromkeys(name for record in records for name in record.versions)
    ends = sorted(record.finished_at_utc for record in records)
    return Provenance(
        trip=trip,
        whole_cycle=whole_cycle,
        runs=len(records),
        cases=cases,
        revisions=dict(Counter(record.git_revision for record in records)),
        versions={
            name: dict(Counter(record.versions.get(name, "unknown") for record in records))
            for name in names
        },
        first_utc=ends[0],
        last_utc=ends[-1],
        interpreted=sum(not record.compiled for record in records),
        wall_h=sum(record.wall.setup_s + record.wall.run_s for record in records) / 3600.0,
    )

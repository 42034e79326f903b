"""From a surveyed campaign and its store to the runs that the report speaks about."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from iptm_core.errors import ScenarioError
from iptm_core.metrics import RunMetrics, figure_values
from iptm_core.settings import ThermalModel
from iptm_reproduction.runs import MissingRun, ReportRun, Results
from iptm_studies.campaign import Campaign
from iptm_studies.run import RunRecord
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import REPRODUCED_CYCLE, RunKind, RunSpec
from iptm_studies.store import ResultStore
from iptm_studies.study import SMALL

COMMAND = "scripts/reproduce run"


@dataclass(frozen=True)
class Provenance:
    """Where the results come from.

    Attributes:
        trip: what the runs of the tables drive, in words.
        whole_cycle: whether that is the whole comprehensive cycle, as in the paper; runs that drive another
            trip are marked.
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


@dataclass(frozen=True)
class _Finished:
    """A case whose run is there."""

    address: str
    key: str
    spec: RunSpec
    metrics: RunMetrics

    @property
    def trip(self) -> str:
        return f"{self.spec.cycle}, slope {self.spec.slope}, {self.metrics.duration_s:.0f} s"

    @property
    def drives_whole_cycle(self) -> bool:
        return self.spec.cycle == REPRODUCED_CYCLE and self.spec.duration_s is None


def gather(store: ResultStore, campaign: Campaign) -> Gathered:
    """Collect the cases of a campaign.

    Args:
        store: where the runs are.
        campaign: studies that were compared with the store (``execution.survey``).

    Returns:
        Its runs; a missing one with its reason.

    Raises:
        ScenarioError: the store has no runs; names their number and the command.
        StoreError: a run has disappeared from the store since the survey.
    """
    finished: list[_Finished] = []
    missing: list[MissingRun] = []
    for state in campaign.cases:
        if state.key is None or state.spec is None or state.metrics is None:
            missing.append(MissingRun(state.address, state.reason))
        else:
            finished.append(_Finished(state.address, state.key, state.spec, state.metrics))
    command = _command(campaign)
    if not finished:
        lacking = Counter(run.study for run in missing)
        raise ScenarioError(
            f"store {store.folder} holds none of the results that the report is made of; missing are "
            f"{', '.join(f'{count} runs of {study}' for study, count in lacking.items())}. "
            f"Compute them with: {command} {' '.join(lacking)}"
        )
    keys = sorted({case.key for case in finished})
    return Gathered(
        Results([_run(store, case) for case in finished], missing),
        _provenance(finished, [store.load(key).record for key in keys]),
        command,
    )


def _command(campaign: Campaign) -> str:
    """Return what computes a study of this campaign, without its name."""
    specs = [case.spec for study in campaign.studies for case in study.cases]
    small = all(
        (spec.cycle, spec.slope, spec.duration_s) == (SMALL.cycle, SMALL.slope, SMALL.duration_s)
        for spec in specs
    )
    return f"{COMMAND} --small" if small else COMMAND


def _run(store: ResultStore, case: _Finished) -> ReportRun:
    inputs = resolve_inputs(case.spec)
    whole = case.spec.kind is RunKind.WHOLE_TRIP
    full_channel = case.spec.thermal_model is ThermalModel.FULL_CHANNEL
    return ReportRun(
        address=case.address,
        values=figure_values(case.metrics),
        parameters=inputs.parameters,
        route=inputs.route,
        strategy=case.spec.strategy,
        load=lambda: store.load(case.key).trajectory,
        whole_trip=store.load(case.key).whole_trip if whole else None,
        channel=store.load(case.key).channel if full_channel else None,
        load_decisions=lambda: store.load(case.key).decisions,
    )


def _provenance(finished: Iterable[_Finished], records: list[RunRecord]) -> Provenance:
    cases = list(finished)
    names = dict.fromkeys(name for record in records for name in record.versions)
    ends = sorted(record.finished_at_utc for record in records)
    trip = Counter(case.trip for case in cases).most_common(1)[0][0]
    return Provenance(
        trip=trip,
        whole_cycle=all(case.drives_whole_cycle for case in cases if case.trip == trip),
        runs=len(records),
        cases=len(cases),
        revisions=dict(Counter(record.git_revision for record in records)),
        versions={
            name: dict(Counter(record.versions.get(name, "unknown") for record in records))
            for name in names
        },
        first_utc=ends[0],
        last_utc=ends[-1],
        interpreted=sum(not record.compiled for record in records),
        wall_h=sum(record.wall_time_s for record in records) / 3600.0,
    )

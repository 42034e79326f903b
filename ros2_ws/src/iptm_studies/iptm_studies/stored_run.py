"""A finished run with its record, as the store keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics import RunMetrics, compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_studies.fingerprint import environment_versions, git_revision
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunSpec
from iptm_studies.single_run import FinishedRun, WallTimes, WholeTripRecord


@dataclass(frozen=True)
class RunRecord:
    """Where a result comes from.

    Attributes:
        wall: wall times of set-up and run.
        compiled: the problem ran as machine code.
        finished_at_utc: end of the run, ISO 8601.
        git_revision: commit of the source, with ``-dirty`` if it was changed.
        versions: versions of interpreter and libraries by name.
        fingerprint: of the code.
    """

    wall: WallTimes
    compiled: bool
    finished_at_utc: str
    git_revision: str
    versions: Mapping[str, str] = field(default_factory=dict)
    fingerprint: str = ""


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run as it was stored.

    Attributes:
        key: key of everything that its numbers depend on.
        spec: specification.
        parameters: parameters it ran with.
        trajectory: what happened.
        decisions: how the decisions came about; None for a whole trip.
        whole_trip: how a whole trip was solved; None for a closed loop.
        record: where the result comes from.
    """

    key: str
    spec: RunSpec
    parameters: ModelParameters
    trajectory: Trajectory
    decisions: DecisionSeries | None
    whole_trip: WholeTripRecord | None
    record: RunRecord

    @cached_property
    def metrics(self) -> RunMetrics:
        """What the run achieved, worked out from its trajectory with today's metrics."""
        return compute_metrics(self.trajectory, self.parameters, self.decisions)


def stored_run(
    key: str, inputs: RunInputs, finished: FinishedRun, finished_at_utc: str
) -> StoredRun:
    """Add the record to what a worker handed back."""
    return StoredRun(
        key=key,
        spec=inputs.spec,
        parameters=inputs.parameters,
        trajectory=finished.trajectory,
        decisions=finished.decisions,
        whole_trip=finished.whole_trip,
        record=RunRecord(
            wall=finished.wall,
            compiled=finished.compiled,
            finished_at_utc=finished_at_utc,
            git_revision=git_revision(),
            versions=environment_versions(),
            fingerprint=inputs.fingerprint,
        ),
    )

"""Observations of a driven trip, in the same form for all drive modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

from iptm_bringup.fault_table.catalogue import PlannedTrip
from iptm_controller.node_reports import is_about_limits
from iptm_core.decision_record import Rung
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import NS_PER_S
from iptm_core.trajectory import Trajectory
from iptm_interfaces.assembly import split_trips
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.stamp_gate import LEAST_REACH_NS
from iptm_studies.random_cars.bounds import BoolArray

_SEVERITY = {Level.OK: 0, Level.WARN: 1, Level.ERROR: 2, Level.STALE: 2}


@dataclass(frozen=True)
class StatusReport:
    """Status of a node on the diagnostics, valid until its next report.

    Attributes:
        time_s: trip time.
        node: name of the node.
        level: severity.
        reason: message of the status.
    """

    time_s: float
    node: str
    level: Level
    reason: str

    @property
    def is_calm(self) -> bool:
        """Whether the status is OK, or only reports limits that the trip still violates."""
        return self.level is Level.OK or (self.level is Level.WARN and is_about_limits(self.reason))


NO_REPORT = StatusReport(0.0, "", Level.OK, "")


@dataclass(frozen=True)
class FaultInterval:
    """Actual start and end of a fault; process faults do not keep to trip time.

    Attributes:
        start_s: trip time.
        end_s: trip time.
    """

    start_s: float
    end_s: float


class TripTime:
    """Maps received messages to the time of the last trip of a run.

    A restarted plant begins at 0 again, a duplicate plant publishes another time, and a node that has
    just been started has none. Messages from before the last trip have negative times.
    """

    def __init__(self, clocks_ns: Sequence[int]) -> None:
        """Set up from the stamps of all clocks, in the order of arrival."""
        stamped = ((stamp, at) for at, stamp in enumerate(clocks_ns))
        counted = frozenset(split_trips(stamped)[-1].values())
        self._begins = min(counted, default=0)
        self._ended_ns = max(clocks_ns[: self._begins], default=0) + NS_PER_S
        own = (stamp if at in counted else -1 for at, stamp in enumerate(clocks_ns))
        self._newest_ns = list(accumulate(own, max))

    def at_s(self, about_ns: int, clocks: int) -> float:
        """Return the trip time in s of a message from its stamp and the number of clocks received before."""
        if clocks <= self._begins:
            return (
                min(about_ns - self._ended_ns, 0) / NS_PER_S
                if self._begins
                else about_ns / NS_PER_S
            )
        now_ns = self._newest_ns[clocks - 1]
        return (about_ns if abs(about_ns - now_ns) <= LEAST_REACH_NS else now_ns) / NS_PER_S


@dataclass(frozen=True, eq=False)
class ObservedTrip:
    """A driven trip.

    Attributes:
        plan: what was to be driven.
        parameters: of the vehicle.
        trajectory: the driven trajectory, with the effective leader.
        leader_apart: rows in which that leader is not where the leader of the route is, shape (n,).
        rungs: source of the commands, by tick.
        reports: status reports in order.
        intervals: actual start and end of each fault in the order of the plan; None if not reached.
        ended: why the trip ended early, empty if it did not.
    """

    plan: PlannedTrip
    parameters: ModelParameters
    trajectory: Trajectory
    leader_apart: BoolArray
    rungs: Mapping[float, Rung]
    reports: Sequence[StatusReport]
    intervals: Sequence[FaultInterval | None]
    ended: str = ""

    def worst(self) -> list[StatusReport]:
        """Return the worst status of all nodes at every row, OK before the first report."""
        rows = [NO_REPORT] * len(self.trajectory)
        for node in sorted({report.node for report in self.reports}):
            for row, report in enumerate(self._status_by_row(node)):
                if _SEVERITY[report.level] > _SEVERITY[rows[row].level]:
                    rows[row] = report
        return rows

    def _status_by_row(self, node: str) -> list[StatusReport]:
        """Return the status of a node at every row."""
        own = [report for report in self.reports if report.node == node]
        rows, place, report = [], 0, NO_REPORT
        for time_s in self.trajectory.time_s.tolist():
            while place < len(own) and own[place].time_s <= time_s + 1e-9:
                report = own[place]
                place += 1
            rows.append(report)
        return rows

"""What is known of a trip after it was driven, on whichever way: the same for all, to be judged alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

from iptm_bringup.fault_table.catalogue import PlannedTrip
from iptm_controller.node_reports import is_about_limits
from iptm_core.decision_record import Rung
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_core.trip_time import NS_PER_S
from iptm_interfaces.assembly import split_trips
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.stamp_gate import LEAST_REACH_NS
from iptm_studies.random_cars.bounds import BoolArray

_SEVERITY = {Level.OK: 0, Level.WARN: 1, Level.ERROR: 2, Level.STALE: 2}


@dataclass(frozen=True)
class Statement:
    """What a node said on the diagnostics from a trip time on, until it said something else.

    Attributes:
        time_s: trip time.
        node: who.
        level: severity.
        reason: the sentence.
    """

    time_s: float
    node: str
    level: Level
    reason: str

    @property
    def is_calm(self) -> bool:
        """Whether it complains about nothing, or only about limits that the trip still breaks."""
        return self.level is Level.OK or (self.level is Level.WARN and is_about_limits(self.reason))


QUIET = Statement(0.0, "", Level.OK, "")


@dataclass(frozen=True)
class Happened:
    """When a fault really began and ended; those of processes do not keep to trip time.

    Attributes:
        start_s: trip time.
        end_s: trip time.
    """

    start_s: float
    end_s: float


class TripTime:
    """Puts what was heard in a run where it belongs in the time of its last trip.

    A plant that was started again begins at 0 once more, a second plant beside the first one tells another
    time, and a node that has just been started knows none. What was heard before the last trip has negative
    times.
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
        """Return the time in s of what was heard after so many clocks and is about some instant."""
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
        trajectory: what happened, with the leader that counted.
        leader_apart: rows in which that leader is not where the one of the route is, shape (n,).
        rungs: where the commands came from, by tick.
        statements: what was said, in order.
        happened: when each fault began and ended, in the order of the plan; None for one that never came.
        ended: why the trip ended early, empty if it did not.
    """

    plan: PlannedTrip
    parameters: ModelParameters
    trajectory: Trajectory
    leader_apart: BoolArray
    rungs: Mapping[float, Rung]
    statements: Sequence[Statement]
    happened: Sequence[Happened | None]
    ended: str = ""

    def worst(self) -> list[Statement]:
        """Return the worst of what the nodes were saying at every row, nothing before they said anything."""
        rows = [QUIET] * len(self.trajectory)
        for node in sorted({said.node for said in self.statements}):
            for row, said in enumerate(self._spoken(node)):
                if _SEVERITY[said.level] > _SEVERITY[rows[row].level]:
                    rows[row] = said
        return rows

    def _spoken(self, node: str) -> list[Statement]:
        """Return what a node was saying at every row."""
        own = [said for said in self.statements if said.node == node]
        rows, place, said = [], 0, QUIET
        for time_s in self.trajectory.time_s.tolist():
            while place < len(own) and own[place].time_s <= time_s + 1e-9:
                said = own[place]
                place += 1
            rows.append(said)
        return rows

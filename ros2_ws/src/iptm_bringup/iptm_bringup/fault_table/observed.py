"""What is known of a trip after it was driven, on whichever way: the same for all, to be judged alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from iptm_bringup.fault_table.catalogue import PlannedTrip
from iptm_core.decision_record import Rung
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_interfaces.diagnostics import Level
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


@dataclass(frozen=True)
class Happened:
    """When a fault really began and ended; those of processes do not keep to trip time.

    Attributes:
        start_s: trip time.
        end_s: trip time.
    """

    start_s: float
    end_s: float


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

    def levels(self, node: str) -> list[Level]:
        """Return what a node's level was at every row; OK before it said anything."""
        own = [said for said in self.statements if said.node == node]
        levels, place, level = [], 0, Level.OK
        for time_s in self.trajectory.time_s.tolist():
            while place < len(own) and own[place].time_s <= time_s + 1e-9:
                level = own[place].level
                place += 1
            levels.append(level)
        return levels

    def worst_levels(self) -> list[Level]:
        """Return the worst level of all nodes at every row."""
        nodes = sorted({said.node for said in self.statements})
        by_node = [self.levels(node) for node in nodes]
        if not by_node:
            return [Level.OK] * len(self.trajectory)
        return [max(levels, key=_SEVERITY.__getitem__) for levels in zip(*by_node, strict=True)]

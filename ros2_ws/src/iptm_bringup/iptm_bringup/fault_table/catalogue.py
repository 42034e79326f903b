"""The faults of the table as data, and the trips that they are put into."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes import Route, build_route
from iptm_core.strict_mapping import StrictMapping
from iptm_core.text_enum import TextEnum
from iptm_core.trajectory import Trajectory
from iptm_faults.fault import Fault, faults_from, in_order
from iptm_faults.kinds import FaultPlace

FIRST_S = 60.0
"""No fault begins before: the trip has to be under way."""
LOOK_AHEAD_S = 60.0
"""Where nothing comes before it, a fault has so long to find a tight moment; else as long as the calm."""
CALM_S = 15.0
"""Trip time between what a fault is given to end in and the next one."""
NORMAL_WITHIN = 5

REAL_TIME_RATE = 10.0
"""Seconds of the trip in a second of the wall clock, where trips follow it."""
START_UP_S = 6.0
"""Wall time in which a process that was started takes part."""

_OWN_KEYS = ("said", "quiet_in", "normal_within", "ends", "alone", "cycle")


class Way(TextEnum):
    """How a trip is driven."""

    HEADLESS = "headless"
    LOCK_STEP = "lock_step"
    REAL_TIME = "real_time"


class Said(TextEnum):
    """When a fault has to be told on the diagnostics."""

    ALWAYS = "always"
    ONCE = "once"
    NOTHING = "nothing"


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    Attributes:
        fault: the fault; when it begins is left to the trip.
        said: when it has to be told.
        quiet_in: ways in which it need not be told.
        normal_within: ticks after its end after which all has to be normal.
        ends: whether the run may end with it.
        alone: whether it needs a trip of its own over ROS 2.
        cycle: the only cycle for it, empty for all of the table.
    """

    fault: Fault
    said: Said
    quiet_in: tuple[Way, ...] = ()
    normal_within: int = NORMAL_WITHIN
    ends: bool = False
    alone: bool = False
    cycle: str = ""

    @property
    def name(self) -> str:
        """What the row is called: kind, size, target and probability."""
        return self.fault.describe().split(" at ")[0] + (
            f" in {100.0 * self.fault.probability:g} % of the ticks"
            if self.fault.probability < 1.0
            else ""
        )

    def goes(self, way: Way) -> bool:
        """Return whether it can happen on a way."""
        return way is not Way.HEADLESS or self.fault.spec.headless

    def asked(self, way: Way) -> Said:
        """Return when it has to be told on a way."""
        return Said.NOTHING if way in self.quiet_in else self.said


@dataclass(frozen=True, eq=False)
class PlannedTrip:
    """A trip with faults one after the other.

    Attributes:
        way: how it is driven.
        cycle: what the leader drives.
        entries: rows of the table in the order of their beginning, each with when it begins.
        route: leader and road, as long as the trip takes.
    """

    way: Way
    cycle: str
    entries: tuple[tuple[Entry, Fault], ...]
    route: Route

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults of the trip."""
        return in_order(fault for _, fault in self.entries)

    @property
    def name(self) -> str:
        """Name for files and progress: way, cycle, the first fault and how many others there are."""
        first, others = self.entries[0][1], len(self.entries) - 1
        parts = [self.way, self.cycle, first.kind, first.target, f"and_{others}" if others else ""]
        return "_".join(str(part) for part in parts if part)


def read_catalogue(path: Path | None = None) -> tuple[tuple[str, ...], tuple[Entry, ...]]:
    """Return the cycles and the rows of a catalogue, by default the shipped one.

    Raises:
        ScenarioError: the file is malformed.
    """
    path = path or Path(__file__).parent / "catalogue.yaml"
    written = StrictMapping(read_yaml(path, ScenarioError), path.name, ("cycles", "faults"))
    cycles = tuple(str(cycle) for cycle in written.entries("cycles"))
    entries = []
    for number, content in enumerate(written.entries("faults"), start=1):
        row = StrictMapping(content, f"{path.name}: row {number}")
        given = {key: row.content[key] for key in row if key not in _OWN_KEYS}
        (fault,) = faults_from([given], f"{path.name}: row {number}")
        ways = StrictMapping({"quiet_in": row.content.get("quiet_in", [])}, row.where)
        entries.append(
            Entry(
                fault,
                Said(row.choice("said", [said.value for said in Said])),
                tuple(Way(way) for way in ways.entries("quiet_in", may_be_empty=True)),
                int(row.number("normal_within")) if "normal_within" in row else NORMAL_WITHIN,
                ends=bool(row.content.get("ends", False)),
                alone=bool(row.content.get("alone", False)),
                cycle=row.text("cycle", ""),
            )
        )
    return cycles, tuple(entries)


def sound_trip(cycle: str) -> PlannedTrip:
    """Return a whole cycle without ROS and without faults.

    Raises:
        IptmError: the cycle is not known.
    """
    return PlannedTrip(Way.HEADLESS, cycle, (), _route(cycle))


def plan_trips(
    entries: Sequence[Entry], way: Way, cycle: str, sound: Trajectory
) -> list[PlannedTrip]:
    """Return the trips of one way and cycle: without ROS one for each fault, over ROS 2 as few as possible.

    Args:
        entries: rows of the table; those that cannot happen on the way are left out.
        way: how they are driven.
        cycle: what the leader drives.
        sound: the whole cycle as driven without faults; faults begin where it is tight.
    """
    fitting = [entry for entry in entries if entry.goes(way)]
    return [
        PlannedTrip(way, cycle, tuple(group), _route(cycle, _duration_s(group, way, sound)))
        for group in _groups(fitting, way, sound)
    ]


def _groups(
    entries: Iterable[Entry], way: Way, sound: Trajectory
) -> list[list[tuple[Entry, Fault]]]:
    groups: list[list[tuple[Entry, Fault]]] = []
    was_alone = False
    for entry in entries:
        # In lock-step trip time may run on while a process starts: nobody knows how far.
        of_process = entry.fault.spec.place is FaultPlace.PROCESS
        alone = entry.alone or way is Way.HEADLESS or (of_process and way is Way.LOCK_STEP)
        last = groups[-1] if groups and not was_alone and not alone else None
        start_s = _tight_s(sound, FIRST_S)
        if last is not None:
            earliest_s = _over_s(*last[-1]) + CALM_S
            if (
                _over_s(entry, replace(entry.fault, start_s=earliest_s + CALM_S))
                <= sound.time_s[-1]
            ):
                start_s = _tight_s(sound, earliest_s, CALM_S)
            else:
                last = None
        was_alone = alone
        placed = (entry, replace(entry.fault, start_s=start_s))
        if last is None:
            groups.append([placed])
        else:
            last.append(placed)
    return groups


def _over_s(entry: Entry, fault: Fault) -> float:
    """Return when a fault has to be over and forgotten; one of a process lasts by the wall clock."""
    lasts_s = fault.duration_s
    if fault.spec.place is FaultPlace.PROCESS:
        wall_s = fault.magnitude if fault.spec.has_size else 0.0
        lasts_s = REAL_TIME_RATE * (wall_s + START_UP_S)
    return fault.start_s + lasts_s + entry.normal_within


def _tight_s(sound: Trajectory, earliest_s: float, within_s: float = LOOK_AHEAD_S) -> float:
    """Return when the host follows fastest and closest from a time on: smallest time headway."""
    rows = (sound.time_s >= earliest_s) & (sound.time_s < earliest_s + within_s)
    headway_s = sound.gap_m[rows] / (sound.speed_m_s[rows] + 1.0)
    return float(sound.time_s[rows][int(np.argmin(headway_s))])


def _route(cycle: str, duration_s: float | None = None) -> Route:
    gap_m = load_parameters().values.gap.initial_gap_m
    return build_route(cycle, "as_designed", initial_gap_m=gap_m, duration_s=duration_s)


def _duration_s(entries: list[tuple[Entry, Fault]], way: Way, sound: Trajectory) -> float:
    entry, fault = entries[-1]
    whole_s = float(sound.time_s[-1])
    of_process = fault.spec.place is FaultPlace.PROCESS
    if way is Way.LOCK_STEP and of_process and not entry.ends:
        return whole_s
    return min(whole_s, float(np.ceil(_over_s(entry, fault) + CALM_S)))

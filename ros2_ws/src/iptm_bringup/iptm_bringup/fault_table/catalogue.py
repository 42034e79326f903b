"""Catalogue of faults and the trips in which they are injected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes import Route, build_route
from iptm_core.trajectory import Trajectory
from iptm_core.user_input import StrictMapping
from iptm_faults.fault import Fault, faults_from, in_order
from iptm_faults.kinds import FaultPlace

FIRST_S = 60.0
"""Earliest trip time at which a fault begins."""
LOOK_AHEAD_S = 60.0
"""Search window for the worst moment of the first fault; later faults use CALM_S."""
CALM_S = 15.0
"""Trip time between the time by which one fault must have settled and the start of the next."""
NORMAL_WITHIN = 5

REAL_TIME_RATE = 10.0
"""Trip seconds per wall-clock second in real-time mode."""
START_UP_S = 6.0
"""Wall time that a started process may need before it takes part."""

_OWN_KEYS = ("reported", "silent_in", "normal_within", "ends", "alone", "cycle")


class DriveMode(TextEnum):
    """How a trip is driven."""

    HEADLESS = "headless"
    LOCK_STEP = "lock_step"
    REAL_TIME = "real_time"


class ReportPolicy(TextEnum):
    """When a fault must be reported on the diagnostics."""

    ALWAYS = "always"
    ONCE = "once"
    NEVER = "never"


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    Attributes:
        fault: the fault; its start time is set by the trip.
        reported: when it must be reported.
        silent_in: modes in which no report is required.
        normal_within: ticks after the end of the fault within which operation must be normal.
        ends: whether the fault may end the run.
        alone: whether it needs its own trip over ROS 2.
        cycle: the only cycle it is driven on; empty for all cycles of the table.
    """

    fault: Fault
    reported: ReportPolicy
    silent_in: tuple[DriveMode, ...] = ()
    normal_within: int = NORMAL_WITHIN
    ends: bool = False
    alone: bool = False
    cycle: str = ""

    @property
    def name(self) -> str:
        """Label of the row: kind, size, target and probability."""
        return self.fault.describe().split(" at ")[0] + (
            f" in {100.0 * self.fault.probability:g} % of the ticks"
            if self.fault.probability < 1.0
            else ""
        )

    def supports(self, mode: DriveMode) -> bool:
        """Return whether the fault can be injected in a mode."""
        return mode is not DriveMode.HEADLESS or self.fault.spec.headless

    def report_policy(self, mode: DriveMode) -> ReportPolicy:
        """Return when the fault must be reported in a mode."""
        return ReportPolicy.NEVER if mode in self.silent_in else self.reported


@dataclass(frozen=True, eq=False)
class PlannedTrip:
    """A trip with one or more faults in sequence.

    Attributes:
        mode: how it is driven.
        cycle: what the leader drives.
        entries: rows of the table in order of start time, each with its placed fault.
        route: leader and road, cut to the duration of the trip.
    """

    mode: DriveMode
    cycle: str
    entries: tuple[tuple[Entry, Fault], ...]
    route: Route

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults of the trip."""
        return in_order(fault for _, fault in self.entries)

    @property
    def name(self) -> str:
        """Name for files and progress: mode, cycle, the first fault and the number of others."""
        first, others = self.entries[0][1], len(self.entries) - 1
        parts = [self.mode, self.cycle, first.kind, first.target, f"and_{others}" if others else ""]
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
        modes = StrictMapping({"silent_in": row.content.get("silent_in", [])}, row.where)
        entries.append(
            Entry(
                fault,
                ReportPolicy(row.choice("reported", [policy.value for policy in ReportPolicy])),
                tuple(DriveMode(mode) for mode in modes.entries("silent_in", may_be_empty=True)),
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
    return PlannedTrip(DriveMode.HEADLESS, cycle, (), _route(cycle))


def plan_trips(
    entries: Sequence[Entry], mode: DriveMode, cycle: str, sound: Trajectory
) -> list[PlannedTrip]:
    """Return the trips of one mode and cycle: headless one per fault, over ROS 2 as few as possible.

    Args:
        entries: rows of the table; those that cannot be injected in the mode are left out.
        mode: how they are driven.
        cycle: what the leader drives.
        sound: the fault-free run of the whole cycle; faults begin where its time headway is smallest.
    """
    fitting = [entry for entry in entries if entry.supports(mode)]
    return [
        PlannedTrip(mode, cycle, tuple(group), _route(cycle, _duration_s(group, mode, sound)))
        for group in _groups(fitting, mode, sound)
    ]


def _groups(
    entries: Iterable[Entry], mode: DriveMode, sound: Trajectory
) -> list[list[tuple[Entry, Fault]]]:
    groups: list[list[tuple[Entry, Fault]]] = []
    was_alone = False
    for entry in entries:
        # In lock-step, trip time may advance by an unknown amount while a process starts.
        of_process = entry.fault.spec.place is FaultPlace.PROCESS
        alone = (
            entry.alone
            or mode is DriveMode.HEADLESS
            or (of_process and mode is DriveMode.LOCK_STEP)
        )
        last = groups[-1] if groups and not was_alone and not alone else None
        start_s = _closest_s(sound, FIRST_S)
        if last is not None:
            earliest_s = _settled_s(*last[-1]) + CALM_S
            if (
                _settled_s(entry, replace(entry.fault, start_s=earliest_s + CALM_S))
                <= sound.time_s[-1]
            ):
                start_s = _closest_s(sound, earliest_s, CALM_S)
            else:
                last = None
        was_alone = alone
        placed = (entry, replace(entry.fault, start_s=start_s))
        if last is None:
            groups.append([placed])
        else:
            last.append(placed)
    return groups


def _settled_s(entry: Entry, fault: Fault) -> float:
    """Return the trip time by which a fault must have settled; process faults last in wall time."""
    lasts_s = fault.duration_s
    if fault.spec.place is FaultPlace.PROCESS:
        wall_s = fault.magnitude if fault.spec.has_size else 0.0
        lasts_s = REAL_TIME_RATE * (wall_s + START_UP_S)
    return fault.start_s + lasts_s + entry.normal_within


def _closest_s(sound: Trajectory, earliest_s: float, within_s: float = LOOK_AHEAD_S) -> float:
    """Return the time of the smallest time headway within a window."""
    rows = (sound.time_s >= earliest_s) & (sound.time_s < earliest_s + within_s)
    headway_s = sound.gap_m[rows] / (sound.speed_m_s[rows] + 1.0)
    return float(sound.time_s[rows][int(np.argmin(headway_s))])


def _route(cycle: str, duration_s: float | None = None) -> Route:
    gap_m = load_parameters().values.gap.initial_gap_m
    return build_route(cycle, "as_designed", initial_gap_m=gap_m, duration_s=duration_s)


def _duration_s(entries: list[tuple[Entry, Fault]], mode: DriveMode, sound: Trajectory) -> float:
    entry, fault = entries[-1]
    whole_s = float(sound.time_s[-1])
    of_process = fault.spec.place is FaultPlace.PROCESS
    if mode is DriveMode.LOCK_STEP and of_process and not entry.ends:
        return whole_s
    return min(whole_s, float(np.ceil(_settled_s(entry, fault) + CALM_S)))

"""Catalogue of faults and the trials in which they are injected."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from studies.drives import trip
from studies.session import inputs_of
from studies.trial import REAL_TIME_RATE, DriveMode, Trial

from iptm.faults.fault import Fault, faults_from
from iptm.faults.kinds import FaultPlace
from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.trajectory import Trajectory
from iptm_core.user_input import StrictMapping

FIRST_S = 60.0
"""Earliest trip time at which a fault begins."""
LOOK_AHEAD_S = 60.0
"""Search window for the worst moment of a fault."""
CALM_S = 15.0
"""Trip time after the time by which a fault must have settled."""
NORMAL_WITHIN = 5

START_UP_S = 6.0
"""Wall time that a started process may need before it takes part."""

_OWN_KEYS = ("reported", "silent_in", "normal_within", "ends", "cycle")


class ReportPolicy(TextEnum):
    """When a fault must be reported on the diagnostics."""

    ALWAYS = "always"
    ONCE = "once"
    NEVER = "never"


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    Attributes:
        fault: the fault; its start time is set by the trial.
        reported: when it must be reported.
        silent_in: modes in which no report is required.
        normal_within: ticks after the end of the fault within which operation must be normal.
        ends: whether the fault may end the run.
        cycle: the only cycle it is driven on; empty for all cycles of the table.
    """

    fault: Fault
    reported: ReportPolicy = ReportPolicy.NEVER
    silent_in: tuple[DriveMode, ...] = ()
    normal_within: int = NORMAL_WITHIN
    ends: bool = False
    cycle: str = ""

    @property
    def name(self) -> str:
        """Label of the row: kind, size, target and probability."""
        return self.fault.describe().split(" at ")[0] + (
            f" in {100.0 * self.fault.probability:g} % of the ticks"
            if self.fault.probability < 1.0
            else ""
        )

    @property
    def hits_process(self) -> bool:
        """Whether it hits a process; then it lasts in wall time."""
        return self.fault.spec.place is FaultPlace.PROCESS

    def supports(self, mode: DriveMode) -> bool:
        """Return whether the fault can be injected in a mode."""
        return mode is not DriveMode.HEADLESS or self.fault.spec.headless

    def settled_s(self, start_s: float) -> float:
        """Return the trip time by which operation must be normal if the fault begins at another one."""
        lasts_s = self.fault.duration_s
        if self.hits_process:
            wall_s = self.fault.magnitude if self.fault.spec.has_size else 0.0
            lasts_s = REAL_TIME_RATE * (wall_s + START_UP_S)  # in lock-step the pace is the same
        return start_s + lasts_s + self.normal_within


@dataclass(frozen=True, eq=False)
class Placed:
    """A trial, and the row of the table that it tries."""

    trial: Trial
    entry: Entry


def trial_on(
    cycle: str,
    duration_s: float | None = None,
    mode: DriveMode = DriveMode.HEADLESS,
    faults: Iterable[Fault] = (),
) -> Trial:
    """Return a trial on the beginning of a cycle, None for all of it."""
    placed = tuple(faults)
    given: dict[str, Any] = {"faults": placed} if mode is DriveMode.HEADLESS and placed else {}
    return Trial(mode, placed, inputs_of(trip(cycle, duration_s=duration_s, **given)).checked())


def read_catalogue(path: Path | None = None) -> tuple[tuple[str, ...], tuple[Entry, ...]]:
    """Return the cycles and the rows of a catalogue, by default the shipped one.

    Raises:
        ScenarioError: the file is malformed.
    """
    path = path or Path(__file__).parent / "catalogue.yaml"
    written = StrictMapping(read_yaml(path, ScenarioError), path.name, ("cycles", "faults"))
    rows = enumerate(written.entries("faults"), start=1)
    entries = tuple(_entry(content, f"{path.name}: row {number}") for number, content in rows)
    return tuple(str(cycle) for cycle in written.entries("cycles")), entries


def _entry(content: Any, where: str) -> Entry:
    row = StrictMapping(content, where)
    (fault,) = faults_from([{key: row.content[key] for key in row if key not in _OWN_KEYS}], where)
    modes = StrictMapping({"silent_in": row.content.get("silent_in", [])}, where)
    return Entry(
        fault,
        ReportPolicy(row.choice("reported", [policy.value for policy in ReportPolicy])),
        tuple(DriveMode(mode) for mode in modes.entries("silent_in", may_be_empty=True)),
        int(row.number("normal_within")) if "normal_within" in row else NORMAL_WITHIN,
        ends=bool(row.content.get("ends", False)),
        cycle=row.text("cycle", ""),
    )


def plan_trials(
    entries: Iterable[Entry], mode: DriveMode, cycle: str, fault_free: Trajectory
) -> list[Placed]:
    """Return the trials of one mode and cycle, one per fault.

    Args:
        entries: rows of the table; those that cannot be injected in the mode are left out.
        mode: how they are driven.
        cycle: what the leader drives.
        fault_free: the run of the whole cycle; faults begin where its time headway is smallest.
    """
    start_s, whole_s = _closest_s(fault_free), float(fault_free.time_s[-1])
    placed = []
    for entry in entries:
        if entry.supports(mode):
            duration_s = min(whole_s, float(np.ceil(entry.settled_s(start_s) + CALM_S)))
            faults = [replace(entry.fault, start_s=start_s)]
            placed.append(Placed(trial_on(cycle, duration_s, mode, faults), entry))
    return placed


def _closest_s(fault_free: Trajectory) -> float:
    """Return the time of the smallest time headway within the window."""
    rows = (fault_free.time_s >= FIRST_S) & (fault_free.time_s < FIRST_S + LOOK_AHEAD_S)
    headway_s = fault_free.gap_m[rows] / (fault_free.speed_m_s[rows] + 1.0)
    return float(fault_free.time_s[rows][int(np.argmin(headway_s))])

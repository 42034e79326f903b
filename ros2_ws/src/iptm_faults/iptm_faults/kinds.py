"""Every kind of fault: where it takes place, what it does, and what its size means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from iptm_core.text_enum import TextEnum


class FaultPlace(Enum):
    """Where a fault takes place."""

    TRAFFIC = "traffic"
    """On the road: the leader that counts behaves otherwise. All others leave the truth alone."""
    PREVIEW = "preview"
    LEADER = "leader"
    ROAD = "road"
    STATE = "state"
    """What the controller is told, by topic."""
    CLOCK = "clock"
    """What the bridge is told of the time."""
    STAMPS = "stamps"
    """Messages of a stranger beside the right ones."""
    SOLVER = "solver"
    PROCESS = "process"


class FaultKind(TextEnum):
    """What goes wrong; `KINDS` says how."""

    LEADER_CUT_IN = "leader_cut_in"
    LEADER_HARD_STOP = "leader_hard_stop"
    LEADER_GONE = "leader_gone"
    PREVIEW_LOST = "preview_lost"
    PREVIEW_FROZEN = "preview_frozen"
    PREVIEW_STALE = "preview_stale"
    PREVIEW_EMPTY = "preview_empty"
    PREVIEW_UNORDERED = "preview_unordered"
    PREVIEW_NAN = "preview_nan"
    PREVIEW_JUMPING = "preview_jumping"
    PREVIEW_FUTURE = "preview_future"
    LEADER_LOST = "leader_lost"
    LEADER_NAN = "leader_nan"
    LEADER_OVERLAP = "leader_overlap"
    LEADER_JUMPING = "leader_jumping"
    SLOPE_STEP = "slope_step"
    SLOPE_NAN = "slope_nan"
    STATE_LATE = "state_late"
    STATE_REPEATED = "state_repeated"
    STATE_BACKWARDS = "state_backwards"
    STATE_NAN = "state_nan"
    STATE_OVERHEATED = "state_overheated"
    STATE_JUMPING = "state_jumping"
    CLOCK_PAUSED = "clock_paused"
    CLOCK_JUMP = "clock_jump"
    FOREIGN_CLOCK = "foreign_clock"
    FOREIGN_LEADER = "foreign_leader"
    FOREIGN_PREVIEW = "foreign_preview"
    FOREIGN_STATE = "foreign_state"
    SOLVER_TIMEOUT = "solver_timeout"
    SOLVER_EXCEPTION = "solver_exception"
    SOLVER_NOT_CONVERGED = "solver_not_converged"
    PROCESS_KILLED = "process_killed"
    PROCESS_RESTARTED = "process_restarted"
    PROCESS_FROZEN = "process_frozen"
    PROCESS_DOUBLED = "process_doubled"
    DISK_FULL = "disk_full"


@dataclass(frozen=True)
class KindSpec:
    """What a kind of fault is.

    Attributes:
        place: where it takes place.
        meaning: what it does while it lasts.
        size: what nobody needs to state, NaN where a size means nothing.
        unit: unit of the size.
        smallest: smallest permitted size.
        largest: largest permitted size.
        headless: whether it can happen without ROS: it is one of what is measured, driven or solved.
    """

    place: FaultPlace
    meaning: str
    size: float = math.nan
    unit: str = ""
    smallest: float = -math.inf
    largest: float = math.inf
    headless: bool = True

    @property
    def has_size(self) -> bool:
        """Whether a size means anything."""
        return math.isfinite(self.size)


_WALL = "seconds of the wall clock"

# fmt: off
KINDS: Mapping[FaultKind, KindSpec] = MappingProxyType({
    FaultKind.LEADER_CUT_IN: KindSpec(
        FaultPlace.TRAFFIC, "a car of the leader's speed comes in between, the size ahead of the host; then "
        "it goes and the old leader counts again", 12.0, "m", 0.5, 200.0),
    FaultKind.LEADER_HARD_STOP: KindSpec(
        FaultPlace.TRAFFIC, "the leader brakes to a standstill with the size, stands, then drives off with "
        "2 m/s^2 until it has its own speed again", 8.0, "m/s^2", 0.1, 20.0),
    FaultKind.LEADER_GONE: KindSpec(
        FaultPlace.TRAFFIC, "the leader turns off; from then on the next car counts, which drives as it did, "
        "the size farther on", 300.0, "m", 1.0, 5000.0),
    FaultKind.PREVIEW_LOST: KindSpec(FaultPlace.PREVIEW, "no preview arrives"),
    FaultKind.PREVIEW_FROZEN: KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, with fresh stamps"),
    FaultKind.PREVIEW_STALE: KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, as it was generated"),
    FaultKind.PREVIEW_EMPTY: KindSpec(FaultPlace.PREVIEW, "previews without points"),
    FaultKind.PREVIEW_UNORDERED: KindSpec(FaultPlace.PREVIEW, "two neighbouring points change places"),
    FaultKind.PREVIEW_NAN: KindSpec(FaultPlace.PREVIEW, "one position is not a number"),
    FaultKind.PREVIEW_JUMPING: KindSpec(
        FaultPlace.PREVIEW, "all points but the first move by another random distance every tick, up to the "
        "size", 30.0, "m", 0.1, 1e4),
    FaultKind.PREVIEW_FUTURE: KindSpec(
        FaultPlace.PREVIEW, "generated the size after its publication", 5.0, "s", 0.001, 1e6),
    FaultKind.LEADER_LOST: KindSpec(FaultPlace.LEADER, "the leader is not measured"),
    FaultKind.LEADER_NAN: KindSpec(FaultPlace.LEADER, "its speed is not a number"),
    FaultKind.LEADER_OVERLAP: KindSpec(
        FaultPlace.LEADER, "it is measured the size behind the front of the host", 3.0, "m", 0.1, 1000.0),
    FaultKind.LEADER_JUMPING: KindSpec(
        FaultPlace.LEADER, "it is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4),
    FaultKind.SLOPE_STEP: KindSpec(
        FaultPlace.ROAD, "the map of the road is steeper by the size", 0.1, "rad", -0.5, 0.5),
    FaultKind.SLOPE_NAN: KindSpec(FaultPlace.ROAD, "one slope of the map is not a number"),
    FaultKind.STATE_LATE: KindSpec(
        FaultPlace.STATE, f"the odometry arrives the size later, {_WALL}", 1.0, "s", 0.0, 60.0,
        headless=False),
    FaultKind.STATE_REPEATED: KindSpec(
        FaultPlace.STATE, "instead of the odometry, the one before arrives again", headless=False),
    FaultKind.STATE_BACKWARDS: KindSpec(
        FaultPlace.STATE, "the stamp of the odometry lies the size in the past", 5.0, "s", 1e-3, 1e6,
        headless=False),
    FaultKind.STATE_NAN: KindSpec(FaultPlace.STATE, "the speed is not a number"),
    FaultKind.STATE_OVERHEATED: KindSpec(
        FaultPlace.STATE, "both cells are measured at the size", 150.0, "degC", 100.0, 1000.0),
    FaultKind.STATE_JUMPING: KindSpec(
        FaultPlace.STATE, "the host is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4),
    FaultKind.CLOCK_PAUSED: KindSpec(
        FaultPlace.CLOCK, "no clock reaches the bridge", headless=False),
    FaultKind.CLOCK_JUMP: KindSpec(
        FaultPlace.CLOCK, "the clock tells the bridge a time off by the size", 100.0, "s", -1e9, 1e9,
        headless=False),
    FaultKind.FOREIGN_CLOCK: KindSpec(
        FaultPlace.STAMPS, "20 more clocks a tick, from the size on", 1000.0, "s", -2e9, 2e9, headless=False),
    FaultKind.FOREIGN_LEADER: KindSpec(
        FaultPlace.STAMPS, "20 more leaders a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False),
    FaultKind.FOREIGN_PREVIEW: KindSpec(
        FaultPlace.STAMPS, "20 more previews a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False),
    FaultKind.FOREIGN_STATE: KindSpec(
        FaultPlace.STAMPS, "20 more odometries a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False),
    FaultKind.SOLVER_TIMEOUT: KindSpec(
        FaultPlace.SOLVER, f"it gives up after the size, {_WALL}", 0.1, "s", 0.0, 60.0),
    FaultKind.SOLVER_EXCEPTION: KindSpec(FaultPlace.SOLVER, "it raises an exception"),
    FaultKind.SOLVER_NOT_CONVERGED: KindSpec(FaultPlace.SOLVER, "it stops at its iteration limit"),
    FaultKind.PROCESS_KILLED: KindSpec(
        FaultPlace.PROCESS, "the target is killed (SIGKILL)", headless=False),
    FaultKind.PROCESS_RESTARTED: KindSpec(
        FaultPlace.PROCESS, f"the target is killed, and started again after the size, {_WALL}", 0.0, "s", 0.0,
        600.0, headless=False),
    FaultKind.PROCESS_FROZEN: KindSpec(
        FaultPlace.PROCESS, f"the target is stopped for the size, {_WALL}", 3.0, "s", 0.0, 600.0,
        headless=False),
    FaultKind.PROCESS_DOUBLED: KindSpec(
        FaultPlace.PROCESS, f"a second one of the target takes part beside it for the size, {_WALL}", 3.0,
        "s", 0.0, 600.0, headless=False),
    FaultKind.DISK_FULL: KindSpec(
        FaultPlace.PROCESS, "no file of the target may grow any more (RLIMIT_FSIZE)", headless=False),
})
# fmt: on
"""What each kind is, in the order of the tables."""

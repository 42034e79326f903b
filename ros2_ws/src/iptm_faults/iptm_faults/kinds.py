"""Every kind of fault: where it takes place, what it does, and what its size means."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_faults import effects, events


class FaultPlace(Enum):
    """Where a fault takes place."""

    TRAFFIC = "traffic"
    """On the road: the effective leader behaves differently."""
    VEHICLE = "vehicle"
    """The response of the ego vehicle to its commands. All places below leave the true motion unchanged."""
    PREVIEW = "preview"
    LEADER = "leader"
    ROAD = "road"
    STATE = "state"
    """Inputs of the controller, by topic."""
    CLOCK = "clock"
    """The clock that the bridge receives."""
    STAMPS = "stamps"
    """Additional messages with foreign stamps."""
    SOLVER = "solver"
    PROCESS = "process"


class FaultKind(TextEnum):
    """Kind of a fault; specified in `KINDS`."""

    LEADER_CUT_IN = "leader_cut_in"
    LEADER_HARD_STOP = "leader_hard_stop"
    LEADER_SURPRISE = "leader_surprise"
    LEADER_GONE = "leader_gone"
    COMMAND_DELAYED = "command_delayed"
    BRAKES_WEAK = "brakes_weak"
    PREVIEW_LOST = "preview_lost"
    PREVIEW_FROZEN = "preview_frozen"
    PREVIEW_STALE = "preview_stale"
    PREVIEW_EMPTY = "preview_empty"
    PREVIEW_UNORDERED = "preview_unordered"
    PREVIEW_NAN = "preview_nan"
    PREVIEW_JUMPING = "preview_jumping"
    PREVIEW_FUTURE = "preview_future"
    PREVIEW_EXTRAPOLATED = "preview_extrapolated"
    LEADER_LOST = "leader_lost"
    LEADER_NAN = "leader_nan"
    LEADER_OVERLAP = "leader_overlap"
    LEADER_JUMPING = "leader_jumping"
    GAP_NOISE = "gap_noise"
    GAP_BIAS = "gap_bias"
    LEADER_SPEED_NOISE = "leader_speed_noise"
    LEADER_SPEED_BIAS = "leader_speed_bias"
    SLOPE_STEP = "slope_step"
    SLOPE_NAN = "slope_nan"
    STATE_LATE = "state_late"
    STATE_REPEATED = "state_repeated"
    STATE_BACKWARDS = "state_backwards"
    STATE_NAN = "state_nan"
    STATE_OVERHEATED = "state_overheated"
    STATE_JUMPING = "state_jumping"
    STATE_DELAYED = "state_delayed"
    EGO_SPEED_NOISE = "ego_speed_noise"
    EGO_SPEED_BIAS = "ego_speed_bias"
    ACCELERATION_NOISE = "acceleration_noise"
    ACCELERATION_BIAS = "acceleration_bias"
    TEMPERATURE_NOISE = "temperature_noise"
    TEMPERATURE_BIAS = "temperature_bias"
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
    """Specification of a kind of fault.

    Attributes:
        place: where it takes place.
        meaning: its effect while it is active.
        size: default size, NaN for kinds without a size.
        unit: unit of the size.
        smallest: smallest permitted size.
        largest: largest permitted size.
        headless: whether it can be injected without ROS: it affects measurements, motion or solver.
        effect: its function, as its place needs it, see ``effects`` and ``events``; None where node,
            vehicle, solver or runner does it.
        whole: whether the size is a whole number.
    """

    place: FaultPlace
    meaning: str
    size: float = math.nan
    unit: str = ""
    smallest: float = -math.inf
    largest: float = math.inf
    headless: bool = True
    effect: Callable[..., Any] | None = None
    whole: bool = False

    @property
    def has_size(self) -> bool:
        """Whether a size means anything."""
        return math.isfinite(self.size)


_WALL = "seconds of the wall clock"

# fmt: off
KINDS: Mapping[FaultKind, KindSpec] = MappingProxyType({
    FaultKind.LEADER_CUT_IN: KindSpec(
        FaultPlace.TRAFFIC, "a car of the leader's speed comes in between, the size ahead of the host; then "
        "it goes and the old leader counts again", 12.0, "m", 0.5, 200.0, effect=events.CutIn),
    FaultKind.LEADER_HARD_STOP: KindSpec(
        FaultPlace.TRAFFIC, "the leader brakes to a standstill with the size, stands, then drives off with "
        "2 m/s^2 until it has its own speed again", 8.0, "m/s^2", 0.1, 20.0, effect=events.HardStop),
    FaultKind.LEADER_SURPRISE: KindSpec(
        FaultPlace.TRAFFIC, "as leader_hard_stop, but no preview announces it: each one starts at the "
        "measured leader and returns to its usual drive with 2 m/s^2", 8.0, "m/s^2", 0.1, 20.0,
        effect=events.Surprise),
    FaultKind.LEADER_GONE: KindSpec(
        FaultPlace.TRAFFIC, "the leader turns off; from then on the next car counts, which drives as it did, "
        "the size farther on", 300.0, "m", 1.0, 5000.0, effect=events.Gone),
    FaultKind.COMMAND_DELAYED: KindSpec(
        FaultPlace.VEHICLE, "the vehicle carries out the command of the size earlier", 1.0, "ticks", 1.0,
        20.0, whole=True),
    FaultKind.BRAKES_WEAK: KindSpec(
        FaultPlace.VEHICLE, "the brakes deliver this share of each requested deceleration", 0.7, "1", 0.05,
        1.0),
    FaultKind.PREVIEW_LOST: KindSpec(FaultPlace.PREVIEW, "no preview arrives", effect=effects.lost_preview),
    FaultKind.PREVIEW_FROZEN: KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, with fresh stamps",
        effect=effects.frozen_preview),
    FaultKind.PREVIEW_STALE: KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, as it was generated",
        effect=effects.stale_preview),
    FaultKind.PREVIEW_EMPTY: KindSpec(FaultPlace.PREVIEW, "previews without points",
        effect=effects.empty_preview),
    FaultKind.PREVIEW_UNORDERED: KindSpec(FaultPlace.PREVIEW, "two neighbouring points change places",
        effect=effects.unordered_preview),
    FaultKind.PREVIEW_NAN: KindSpec(FaultPlace.PREVIEW, "one position is not a number",
        effect=effects.nan_preview),
    FaultKind.PREVIEW_JUMPING: KindSpec(
        FaultPlace.PREVIEW, "all points but the first move by another random distance every tick, up to the "
        "size", 30.0, "m", 0.1, 1e4, effect=effects.jumping_preview),
    FaultKind.PREVIEW_FUTURE: KindSpec(
        FaultPlace.PREVIEW, "generated the size after its publication", 5.0, "s", 0.001, 1e6,
        effect=effects.future_preview),
    FaultKind.PREVIEW_EXTRAPOLATED: KindSpec(
        FaultPlace.PREVIEW, "each preview starts as the true one and keeps the acceleration of the size: 0 "
        "is constant speed", 0.0, "m/s^2", -5.0, 5.0, effect=effects.extrapolated_preview),
    FaultKind.LEADER_LOST: KindSpec(FaultPlace.LEADER, "the leader is not measured",
        effect=effects.lost_leader),
    FaultKind.LEADER_NAN: KindSpec(FaultPlace.LEADER, "its speed is not a number",
        effect=effects.nan_leader),
    FaultKind.LEADER_OVERLAP: KindSpec(
        FaultPlace.LEADER, "it is measured the size behind the front of the host", 3.0, "m", 0.1, 1000.0,
        effect=effects.overlapping_leader),
    FaultKind.LEADER_JUMPING: KindSpec(
        FaultPlace.LEADER, "it is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4,
        effect=effects.jumping_leader),
    FaultKind.GAP_NOISE: KindSpec(
        FaultPlace.LEADER, "white noise on the measured gap; the size is its standard deviation", 0.5, "m",
        0.0, 20.0, effect=effects.leader_noise("position_m")),
    FaultKind.GAP_BIAS: KindSpec(
        FaultPlace.LEADER, "the gap is measured larger by the size", 1.0, "m", -20.0, 20.0,
        effect=effects.leader_bias("position_m")),
    FaultKind.LEADER_SPEED_NOISE: KindSpec(
        FaultPlace.LEADER, "white noise on the measured speed of the leader; the size is its standard "
        "deviation", 0.1, "m/s", 0.0, 5.0, effect=effects.leader_noise("speed_m_s")),
    FaultKind.LEADER_SPEED_BIAS: KindSpec(
        FaultPlace.LEADER, "the leader is measured faster by the size", 0.2, "m/s", -5.0, 5.0,
        effect=effects.leader_bias("speed_m_s")),
    FaultKind.SLOPE_STEP: KindSpec(
        FaultPlace.ROAD, "the map of the road is steeper by the size", 0.1, "rad", -0.5, 0.5,
        effect=effects.steeper_slope),
    FaultKind.SLOPE_NAN: KindSpec(FaultPlace.ROAD, "one slope of the map is not a number",
        effect=effects.nan_slope),
    FaultKind.STATE_LATE: KindSpec(
        FaultPlace.STATE, f"the odometry arrives the size later, {_WALL}", 1.0, "s", 0.0, 60.0,
        headless=False),
    FaultKind.STATE_REPEATED: KindSpec(
        FaultPlace.STATE, "instead of the odometry, the one before arrives again", headless=False),
    FaultKind.STATE_BACKWARDS: KindSpec(
        FaultPlace.STATE, "the stamp of the odometry lies the size in the past", 5.0, "s", 1e-3, 1e6,
        headless=False),
    FaultKind.STATE_NAN: KindSpec(FaultPlace.STATE, "the speed is not a number", effect=effects.nan_state),
    FaultKind.STATE_OVERHEATED: KindSpec(
        FaultPlace.STATE, "both cells are measured at the size", 150.0, "degC", 100.0, 1000.0,
        effect=effects.overheated_state),
    FaultKind.STATE_JUMPING: KindSpec(
        FaultPlace.STATE, "the host is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4,
        effect=effects.jumping_state),
    FaultKind.STATE_DELAYED: KindSpec(
        FaultPlace.STATE, "the state arrives the size later, with its own stamps; so does what is matched "
        "with it", 1.0, "ticks", 1.0, 20.0, whole=True),
    FaultKind.EGO_SPEED_NOISE: KindSpec(
        FaultPlace.STATE, "white noise on the measured speed; the size is its standard deviation", 0.1, "m/s",
        0.0, 5.0, effect=effects.state_noise("speed_m_s")),
    FaultKind.EGO_SPEED_BIAS: KindSpec(
        FaultPlace.STATE, "the speed is measured higher by the size", 0.2, "m/s", -5.0, 5.0,
        effect=effects.state_bias("speed_m_s")),
    FaultKind.ACCELERATION_NOISE: KindSpec(
        FaultPlace.STATE, "white noise on the measured acceleration; the size is its standard deviation", 0.1,
        "m/s^2", 0.0, 5.0, effect=effects.state_noise("acceleration_m_s2")),
    FaultKind.ACCELERATION_BIAS: KindSpec(
        FaultPlace.STATE, "the acceleration is measured higher by the size", 0.1, "m/s^2", -5.0, 5.0,
        effect=effects.state_bias("acceleration_m_s2")),
    FaultKind.TEMPERATURE_NOISE: KindSpec(
        FaultPlace.STATE, "white noise on both cell temperatures; the size is its standard deviation", 0.5,
        "K", 0.0, 20.0, effect=effects.temperature_noise),
    FaultKind.TEMPERATURE_BIAS: KindSpec(
        FaultPlace.STATE, "both cells are measured warmer by the size", 2.0, "K", -20.0, 20.0,
        effect=effects.temperature_bias),
    FaultKind.CLOCK_PAUSED: KindSpec(
        FaultPlace.CLOCK, "no clock reaches the bridge", headless=False),
    FaultKind.CLOCK_JUMP: KindSpec(
        FaultPlace.CLOCK, "the bridge receives a clock shifted by the size", 100.0, "s", -1e9, 1e9,
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
        FaultPlace.PROCESS, f"a second instance of the target runs for the size, {_WALL}", 3.0,
        "s", 0.0, 600.0, headless=False),
    FaultKind.DISK_FULL: KindSpec(
        FaultPlace.PROCESS, "no file of the target may grow any more (RLIMIT_FSIZE)", headless=False),
})
# fmt: on
"""Specification of each kind, in the order of the tables."""

"""Kinds of faults: place, effect, and meaning of the size."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING

from iptm.faults import effects, events
from iptm_core.declaration import TextEnum

if TYPE_CHECKING:
    from iptm.faults.fault import Fault


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


@dataclass(frozen=True)
class KindSpec:
    """What a kind of fault is.

    Attributes:
        size: default size, NaN for kinds without a size.
        headless: whether it can be injected without ROS: it affects measurements, motion or solver.
        effect: what it makes of a measured value, see ``effects``; None where node, vehicle, solver or
            runner does it.
        event: what it makes of the lead vehicle, see ``events``; None for faults of other places.
        whole: whether the size is a whole number.
    """

    place: FaultPlace
    meaning: str
    size: float = math.nan
    unit: str = ""
    smallest: float = -math.inf
    largest: float = math.inf
    headless: bool = True
    effect: effects.Effect | None = None
    event: Callable[[Fault], events.TrafficEvent] | None = None
    whole: bool = False

    @property
    def has_size(self) -> bool:
        """Whether a size means anything."""
        return math.isfinite(self.size)


_WALL = "seconds of the wall clock"


class FaultKind(TextEnum):
    """Kind of a fault: its name in files, and in ``spec`` what it is; in the order of the tables."""

    spec: KindSpec

    def __new__(cls, name: str, spec: KindSpec) -> FaultKind:  # noqa: PYI034  Self needs Python 3.11
        """Return a kind."""
        kind = str.__new__(cls, name)
        kind._value_ = name
        kind.spec = spec
        return kind

    # fmt: off
    LEADER_CUT_IN = "leader_cut_in", KindSpec(
        FaultPlace.TRAFFIC, "a car of the leader's speed comes in between, the size ahead of the ego; then "
        "it goes and the old leader counts again", 12.0, "m", 0.5, 200.0, event=events.CutIn)
    LEADER_HARD_STOP = "leader_hard_stop", KindSpec(
        FaultPlace.TRAFFIC, "the leader brakes to a standstill with the size, stands, then drives off with "
        "2 m/s^2 until it has its own speed again", 8.0, "m/s^2", 0.1, 20.0, event=events.HardStop)
    LEADER_SURPRISE = "leader_surprise", KindSpec(
        FaultPlace.TRAFFIC, "as leader_hard_stop, but no preview announces it: each one starts at the "
        "measured leader and returns to its usual drive with 2 m/s^2", 8.0, "m/s^2", 0.1, 20.0,
        event=events.UnannouncedHardStop)
    LEADER_GONE = "leader_gone", KindSpec(
        FaultPlace.TRAFFIC, "the leader turns off; from then on the next car counts, which drives as it did, "
        "the size farther on", 300.0, "m", 1.0, 5000.0, event=events.Gone)
    LEADER_CUT_INS_BY_ROOM = "leader_cut_ins_by_room", KindSpec(
        FaultPlace.TRAFFIC, "cars cut in at random and leave again, the more often the more room the ego "
        "leaves; the size is the mean rate per 100 km in other traffic", 12.4, "1", 0.1, 1000.0,
        event=partial(events.CutIns, law=events.BY_ROOM))
    LEADER_CUT_INS_BY_HEADWAY = "leader_cut_ins_by_headway", KindSpec(
        FaultPlace.TRAFFIC, "the same, the more often the more drivers accept the time gap that is left", 7.2,
        "1", 0.1, 1000.0, event=partial(events.CutIns, law=events.BY_HEADWAY))
    COMMAND_DELAYED = "command_delayed", KindSpec(
        FaultPlace.VEHICLE, "the vehicle carries out the command of the size earlier", 1.0, "ticks", 1.0,
        20.0, whole=True)
    BRAKES_WEAK = "brakes_weak", KindSpec(
        FaultPlace.VEHICLE, "the brakes deliver this share of each requested deceleration", 0.7, "1", 0.05,
        1.0)
    ROAD_SLIPPERY = "road_slippery", KindSpec(
        FaultPlace.VEHICLE, "friction of the road; brakes deliver no more than this times gravity", 0.33,
        "1", 0.05, 1.2)
    ROAD_STEEPER = "road_steeper", KindSpec(
        FaultPlace.VEHICLE, "the road is steeper than on the map by the size, downhill below 0", -0.08, "rad",
        -0.2, 0.2)
    COMPRESSOR_DEAD = "compressor_dead", KindSpec(
        FaultPlace.VEHICLE, "compressor and heater draw no power, whatever is commanded")
    PUMP_OFF = "pump_off", KindSpec(
        FaultPlace.VEHICLE, "the coolant stands: it takes no heat from the cells, and its sensors show their "
        "mean")
    PREVIEW_LOST = "preview_lost", KindSpec(
        FaultPlace.PREVIEW, "no preview arrives", effect=effects.lost)
    PREVIEW_FROZEN = "preview_frozen", KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, with fresh stamps",
        effect=effects.frozen_preview)
    PREVIEW_STALE = "preview_stale", KindSpec(
        FaultPlace.PREVIEW, "the preview of the beginning again and again, as it was generated",
        effect=effects.stale_preview)
    PREVIEW_EMPTY = "preview_empty", KindSpec(FaultPlace.PREVIEW, "previews without points",
        effect=effects.empty_preview)
    PREVIEW_UNORDERED = "preview_unordered", KindSpec(
        FaultPlace.PREVIEW, "two neighbouring points change places",
        effect=effects.unordered_preview)
    PREVIEW_NAN = "preview_nan", KindSpec(FaultPlace.PREVIEW, "one position is not a number",
        effect=effects.nan_preview)
    PREVIEW_JUMPING = "preview_jumping", KindSpec(
        FaultPlace.PREVIEW, "all points but the first move by another random distance every tick, up to the "
        "size", 30.0, "m", 0.1, 1e4, effect=effects.jumping_preview)
    PREVIEW_FUTURE = "preview_future", KindSpec(
        FaultPlace.PREVIEW, "generated the size after its publication", 5.0, "s", 0.001, 1e6,
        effect=effects.future_preview)
    PREVIEW_EXTRAPOLATED = "preview_extrapolated", KindSpec(
        FaultPlace.PREVIEW, "each preview starts as the true one and keeps the acceleration of the size: 0 "
        "is constant speed", 0.0, "m/s^2", -5.0, 5.0, effect=effects.extrapolated_preview)
    LEADER_LOST = "leader_lost", KindSpec(FaultPlace.LEADER, "the leader is not measured",
        effect=effects.lost)
    LEADER_VANISHED = "leader_vanished", KindSpec(
        FaultPlace.LEADER, "the range sensor reports an empty lane", effect=effects.lost)
    LEADER_FROZEN = "leader_frozen", KindSpec(
        FaultPlace.LEADER, "gap and speed of the beginning again and again, with fresh stamps",
        effect=effects.frozen_leader)
    LEADER_NAN = "leader_nan", KindSpec(FaultPlace.LEADER, "its speed is not a number",
        effect=effects.nan_speed)
    LEADER_OVERLAP = "leader_overlap", KindSpec(
        FaultPlace.LEADER, "it is measured the size behind the front of the ego", 3.0, "m", 0.1, 1000.0,
        effect=effects.overlapping)
    LEADER_JUMPING = "leader_jumping", KindSpec(
        FaultPlace.LEADER, "it is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4,
        effect=effects.jumping)
    GAP_NOISE = "gap_noise", KindSpec(
        FaultPlace.LEADER, "white noise on the measured gap; the size is its standard deviation", 0.5, "m",
        0.0, 20.0, effect=effects.noise("position_m"))
    GAP_BIAS = "gap_bias", KindSpec(
        FaultPlace.LEADER, "the gap is measured larger by the size", 1.0, "m", -20.0, 20.0,
        effect=effects.bias("position_m"))
    GAP_ROUNDED = "gap_rounded", KindSpec(
        FaultPlace.LEADER, "the gap is measured in steps of the size", 1.0, "m", 0.001, 20.0,
        effect=effects.rounded_gap)
    LEADER_SPEED_ROUNDED = "leader_speed_rounded", KindSpec(
        FaultPlace.LEADER, "the leader's speed is measured in steps of the size", 0.5, "m/s", 0.001, 5.0,
        effect=effects.rounded_speed)
    LEADER_SPEED_NOISE = "leader_speed_noise", KindSpec(
        FaultPlace.LEADER, "white noise on the measured speed of the leader; the size is its standard "
        "deviation", 0.1, "m/s", 0.0, 5.0, effect=effects.noise("speed_m_s"))
    LEADER_SPEED_BIAS = "leader_speed_bias", KindSpec(
        FaultPlace.LEADER, "the leader is measured faster by the size", 0.2, "m/s", -5.0, 5.0,
        effect=effects.bias("speed_m_s"))
    SLOPE_STEP = "slope_step", KindSpec(
        FaultPlace.ROAD, "the map of the road is steeper by the size", 0.1, "rad", -0.5, 0.5,
        effect=effects.steeper_slope)
    SLOPE_NAN = "slope_nan", KindSpec(FaultPlace.ROAD, "one slope of the map is not a number",
        effect=effects.nan_slope)
    STATE_LATE = "state_late", KindSpec(
        FaultPlace.STATE, f"the state arrives the size later, {_WALL}", 1.0, "s", 0.0, 60.0,
        headless=False)
    STATE_REPEATED = "state_repeated", KindSpec(
        FaultPlace.STATE, "instead of the state, the one before arrives again", headless=False)
    STATE_BACKWARDS = "state_backwards", KindSpec(
        FaultPlace.STATE, "the stamp of the state lies the size in the past", 5.0, "s", 1e-3, 1e6,
        headless=False)
    STATE_NAN = "state_nan", KindSpec(FaultPlace.STATE, "the speed is not a number", effect=effects.nan_speed)
    STATE_OVERHEATED = "state_overheated", KindSpec(
        FaultPlace.STATE, "both cells are measured at the size", 150.0, "degC", 100.0, 1000.0,
        effect=effects.both_cells_read)
    STATE_JUMPING = "state_jumping", KindSpec(
        FaultPlace.STATE, "the ego is measured elsewhere every tick, by up to the size", 5.0, "m", 0.1, 1e4,
        effect=effects.jumping)
    EGO_POSITION_BIAS = "ego_position_bias", KindSpec(
        FaultPlace.STATE, "the ego is measured farther on by the size, as by a jump of its fix", 5.0, "m",
        -20.0, 20.0, effect=effects.bias("position_m"))
    STATE_DELAYED = "state_delayed", KindSpec(
        FaultPlace.STATE, "the state arrives the size later, with its own stamps; so does what is matched "
        "with it", 1.0, "ticks", 1.0, 20.0, whole=True)
    EGO_SPEED_NOISE = "ego_speed_noise", KindSpec(
        FaultPlace.STATE, "white noise on the measured speed; the size is its standard deviation", 0.1, "m/s",
        0.0, 5.0, effect=effects.noise("speed_m_s"))
    EGO_SPEED_BIAS = "ego_speed_bias", KindSpec(
        FaultPlace.STATE, "the speed is measured higher by the size", 0.2, "m/s", -5.0, 5.0,
        effect=effects.bias("speed_m_s"))
    ACCELERATION_NOISE = "acceleration_noise", KindSpec(
        FaultPlace.STATE, "white noise on the measured acceleration; the size is its standard deviation", 0.1,
        "m/s^2", 0.0, 5.0, effect=effects.noise("acceleration_m_s2"))
    ACCELERATION_BIAS = "acceleration_bias", KindSpec(
        FaultPlace.STATE, "the acceleration is measured higher by the size", 0.1, "m/s^2", -5.0, 5.0,
        effect=effects.bias("acceleration_m_s2"))
    TEMPERATURE_NOISE = "temperature_noise", KindSpec(
        FaultPlace.STATE, "white noise on both cell temperatures; the size is its standard deviation", 0.5,
        "K", 0.0, 20.0, effect=effects.temperature_noise)
    TEMPERATURE_BIAS = "temperature_bias", KindSpec(
        FaultPlace.STATE, "both cells are measured warmer by the size", 2.0, "K", -20.0, 20.0,
        effect=effects.temperature_bias)
    CELL_N_TEMPERATURE_BIAS = "cell_n_temperature_bias", KindSpec(
        FaultPlace.STATE, "the last cell alone is measured warmer by the size", 10.0, "K", -20.0, 20.0,
        effect=effects.cell_n_temperature_bias)
    CELL_N_TEMPERATURE_STUCK = "cell_n_temperature_stuck", KindSpec(
        FaultPlace.STATE, "the last cell is measured as at the beginning", effect=effects.cell_n_stuck)
    CELL_TEMPERATURES_STUCK = "cell_temperatures_stuck", KindSpec(
        FaultPlace.STATE, "both cells are measured as at the beginning", effect=effects.both_cells_stuck)
    CELL_N_TEMPERATURE_NAN = "cell_n_temperature_nan", KindSpec(
        FaultPlace.STATE, "the temperature of the last cell is not a number", effect=effects.cell_n_nan)
    CELL_TEMPERATURES_NAN = "cell_temperatures_nan", KindSpec(
        FaultPlace.STATE, "the temperatures of both cells are not numbers", effect=effects.both_cells_nan)
    CELL_N_TEMPERATURE_OPEN = "cell_n_temperature_open", KindSpec(
        FaultPlace.STATE, "the last cell is measured at the size, as by an open circuit", -40.0, "degC",
        -100.0, 0.0, effect=effects.cell_n_reads)
    CELL_TEMPERATURES_OPEN = "cell_temperatures_open", KindSpec(
        FaultPlace.STATE, "both cells are measured at the size, as by open circuits", -40.0, "degC", -100.0,
        0.0, effect=effects.both_cells_read)
    CLOCK_PAUSED = "clock_paused", KindSpec(
        FaultPlace.CLOCK, "no clock reaches the bridge", headless=False)
    CLOCK_JUMP = "clock_jump", KindSpec(
        FaultPlace.CLOCK, "the bridge receives a clock shifted by the size", 100.0, "s", -1e9, 1e9,
        headless=False)
    FOREIGN_CLOCK = "foreign_clock", KindSpec(
        FaultPlace.STAMPS, "20 more clocks a tick, from the size on", 1000.0, "s", -2e9, 2e9, headless=False)
    FOREIGN_LEADER = "foreign_leader", KindSpec(
        FaultPlace.STAMPS, "20 more leaders a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False)
    FOREIGN_PREVIEW = "foreign_preview", KindSpec(
        FaultPlace.STAMPS, "20 more previews a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False)
    FOREIGN_STATE = "foreign_state", KindSpec(
        FaultPlace.STAMPS, "20 more states a tick, stamped from the size on", 1000.0, "s", -2e9, 2e9,
        headless=False)
    SOLVER_TIMEOUT = "solver_timeout", KindSpec(
        FaultPlace.SOLVER, f"it gives up after the size, {_WALL}", 0.1, "s", 0.0, 60.0)
    SOLVER_EXCEPTION = "solver_exception", KindSpec(FaultPlace.SOLVER, "it raises an exception")
    SOLVER_NOT_CONVERGED = "solver_not_converged", KindSpec(
        FaultPlace.SOLVER, "it stops at its iteration limit")
    PROCESS_KILLED = "process_killed", KindSpec(
        FaultPlace.PROCESS, "the target is killed (SIGKILL)", headless=False)
    PROCESS_RESTARTED = "process_restarted", KindSpec(
        FaultPlace.PROCESS, f"the target is killed, and started again after the size, {_WALL}", 0.0, "s", 0.0,
        600.0, headless=False)
    PROCESS_FROZEN = "process_frozen", KindSpec(
        FaultPlace.PROCESS, f"the target is stopped for the size, {_WALL}", 3.0, "s", 0.0, 600.0,
        headless=False)
    PROCESS_DOUBLED = "process_doubled", KindSpec(
        FaultPlace.PROCESS, f"a second instance of the target runs for the size, {_WALL}", 3.0,
        "s", 0.0, 600.0, headless=False)
    DISK_FULL = "disk_full", KindSpec(
        FaultPlace.PROCESS, "no file of the target may grow any more (RLIMIT_FSIZE)", headless=False)
    # fmt: on

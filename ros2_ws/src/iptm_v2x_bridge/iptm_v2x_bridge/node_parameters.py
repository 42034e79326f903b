"""Parameters of the bridge and of the sender, and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from iptm_core.declaration import Settings, declared, parameter
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters.units import KM_H_PER_M_S
from iptm_core.routes import Route, build_route
from iptm_core.settings import (
    VEHICLE_LENGTH_M,
    VEHICLE_LENGTHS_M,
    FrameSettings,
    ModelSettings,
    PreviewSettings,
    RoadSettings,
    StringSettings,
    TickSettings,
)
from iptm_core.trip_time import NS_PER_S
from iptm_v2x_bridge.cam_bridge import DEFAULT_KNOWN_BOUND_M
from iptm_v2x_bridge.prediction.history import History
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile
from iptm_v2x_bridge.prediction.predictor import Predictor
from iptm_v2x_bridge.prediction.received_path import ReceivedPath
from iptm_v2x_bridge.prediction.signals import BoundedBySignals, Signal, SignalPlan
from iptm_v2x_bridge.prediction.speed_limits import BoundedBySpeedLimits, SpeedLimits
from iptm_v2x_bridge.sending.settings import SenderSettings
from iptm_v2x_bridge.source import CycleSource

DEFAULT_CAM_PORT = 8947
LOCALHOST = "127.0.0.1"
UNLIMITED_M_S = 70.0
"""Speed limit of a road whose signals are given without limits."""


class LeaderSource(str, Enum):
    """Where the bridge knows the leader from."""

    CYCLE = "cycle"
    """The cycle itself."""
    CAM = "cam"
    """Cooperative awareness messages that arrive at a UDP port."""
    VEHICLE = "vehicle"
    """The odometry and the plans of another vehicle of the graph."""

    def __str__(self) -> str:
        """Return the bare word, as it is written in a file."""
        return str(self.value)


@dataclass(frozen=True)
class CamSettings(Settings):
    """The leader known from its messages."""

    leader_source: LeaderSource = parameter(
        LeaderSource.CYCLE,
        "cycle: the leader drives the cycle; cam: it is known from the messages that arrive; vehicle: it is "
        "vehicle_ahead, whose plans are the previews; with the latter two the cycle gives the road only",
    )
    cam_address: str = parameter(
        LOCALHOST, "cam: own address to listen at; 0.0.0.0 listens to the whole network"
    )
    cam_port: int = parameter(DEFAULT_CAM_PORT, "cam: UDP port to listen at", "", 0, 65_535)
    cam_lock_step: bool = parameter(
        default=True,
        description="cam: wait at every tick for a sender that follows the clock (scripts/v2x_send); false "
        "answers with what has arrived, as for a radio",
    )
    trip_start_timestamp_ms: int = parameter(
        0,
        "cam: TimestampIts at trip time 0; -1 takes the clock of the computer at the first tick, as for a "
        "radio",
        "ms",
        -1,
        2**53,
    )
    known_bound_m: float = parameter(
        DEFAULT_KNOWN_BOUND_M,
        "cam: a prediction ends where the leader may be farther behind it than this; from there on the "
        "controller keeps its braking reserve",
        "m",
        0.1,
        100.0,
    )
    recorded_packets: str = parameter(
        "",
        "cam: read recorded packets instead of the socket: a bag with v2x/datagrams, or a capture (.pcap, "
        ".pcapng; of UDP datagrams those to cam_port)",
    )
    publish_datagrams: bool = parameter(
        default=False,
        description="cam: publish every datagram on v2x/datagrams, so that a bag holds the radio traffic; "
        "with expected_peers the first answer waits for a listener",
    )
    earlier_drives: str = parameter(
        "",
        "cam: earlier drives of this road to learn from, as in cycle, separated by commas",
    )
    speed_limits_km_h: str = parameter(
        "", "cam: speed limits of the road, <from metre>:<km/h> parts, e.g. '0:50, 1200:70'"
    )
    signals: str = parameter(
        "",
        "cam: signals of the road with plans that repeat themselves, <metre of the stop line>:<cycle in s>:"
        "<s of TimestampIts at which it turns green>:<s for which it is green> parts",
    )
    leader_keeps_rules: bool = parameter(
        default=True, description="cam: what is foretold keeps the speed limits and signals given"
    )
    host_keeps_rules: bool = parameter(
        default=False,
        description="cam: where the speed limits and signals given are stricter than the leader, or none is "
        "there, the host is given a leader that stands for them",
    )
    line_foresight_s: float = parameter(
        60.0,
        "cam: with host_keeps_rules, stop lines that the host reaches later are not looked at",
        "s",
        1.0,
        3600.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.host_keeps_rules and not self.speed_limits_km_h.strip():
            raise ParameterError(
                "speed_limits_km_h is empty with host_keeps_rules; allowed: the limits to be kept"
            )

    def build_limits(self) -> SpeedLimits | None:
        """Return the speed limits, None without any.

        Raises:
            ParameterError: the text is not usable.
        """
        text = self.speed_limits_km_h
        return read_limits(text) if text.strip() else None

    def build_plan(self) -> SignalPlan:
        """Return the signals.

        Raises:
            ParameterError: the text is not usable.
        """
        return read_signals(self.signals)

    def build_predictors(self, route: Route) -> tuple[Predictor, ...]:
        """Return the predictors, the best informed first.

        Args:
            route: the leader's start on it is that of the earlier drives.

        Raises:
            IptmError: a file or a limit is not usable.
        """
        found: list[Predictor] = [ReceivedPath()]
        names = [name.strip() for name in self.earlier_drives.split(",") if name.strip()]
        if names:
            gap_m = route.leader.start_position_m
            drives = [build_route(name, initial_gap_m=gap_m).leader for name in names]
            found.append(LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in drives]))
        limits, plan = self.build_limits(), self.build_plan()
        if self.leader_keeps_rules and plan.signals:
            known = limits or SpeedLimits(np.zeros(1), np.full(1, UNLIMITED_M_S))
            found.append(BoundedBySignals(History(), known, plan))
        elif self.leader_keeps_rules and limits is not None:
            found.append(BoundedBySpeedLimits(History(), limits))
        return (*found, History())


def read_limits(text: str) -> SpeedLimits:
    """Return the speed limits that a text such as `0:50, 1200:70` states.

    Raises:
        ParameterError: it is no such text.
    """
    try:
        pairs = np.array([[float(part) for part in entry.split(":")] for entry in text.split(",")])
        return SpeedLimits(pairs[:, 0], pairs[:, 1] / KM_H_PER_M_S)
    except (ValueError, IndexError, RouteError) as reason:
        raise ParameterError(
            f"speed_limits_km_h is {text!r}; allowed: <from metre>:<km/h> parts joined by commas, metres "
            "increasing, limits above 0"
        ) from reason


def read_signals(text: str) -> SignalPlan:
    """Return the signals that a text such as `1100:80:12.5:42` states, none for an empty one.

    Raises:
        ParameterError: it is no such text.
    """
    entries = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        return SignalPlan(tuple(Signal(*map(float, parts)) for parts in entries))
    except (ValueError, TypeError, RouteError) as reason:
        raise ParameterError(
            f"signals is {text!r}: {reason}; allowed: <metre of the stop line>:<cycle in s>:<turns green at "
            "s>:<green for s> parts joined by commas, metres increasing"
        ) from reason


@dataclass(frozen=True)
class BridgeNodeParameters(
    CamSettings, FrameSettings, TickSettings, PreviewSettings, ModelSettings, RoadSettings
):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    vehicle_ahead: str = declared(StringSettings, "vehicle_ahead")
    leader_length_m: float = parameter(
        VEHICLE_LENGTH_M,
        "vehicle: length of the leader, front to rear bumper",
        "m",
        *VEHICLE_LENGTHS_M,
    )
    initial_gap_m: float = parameter(
        15.0, "position of the leader at t = 0, the host being at 0", "m", 1.0, 500.0
    )
    start_time_s: float = parameter(
        0.0,
        "cycle: trip time at which a trip that starts from a saved state is taken up; predictions of the "
        "ticks before are known then",
        "s",
        0.0,
        1e6,
    )
    expected_peers: int = parameter(
        0, "subscribers of v2x/leader_preview to wait for before the first answer", "", 0, 100
    )

    @property
    def earlier_ticks_ns(self) -> range:
        """Ticks before the one at which the trip is taken up, in integer nanoseconds."""
        return range(0, round(self.start_time_s * NS_PER_S), round(self.period_s * NS_PER_S))

    def build_source(self) -> CycleSource:
        """Return the leader on its road.

        Raises:
            RouteError: the cycle or its file is not usable.
        """
        return CycleSource(self.route(self.initial_gap_m))


class SentDrive(str, Enum):
    """Whose drive the sender tells."""

    CYCLE = "cycle"
    """That of the leader in the cycle."""
    HOST = "host"
    """That of the vehicle whose topics it hears, with its plan as path prediction."""

    def __str__(self) -> str:
        """Return the bare word, as it is written in a file."""
        return str(self.value)


@dataclass(frozen=True)
class SenderNodeParameters(SenderSettings, TickSettings, RoadSettings):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    sent_drive: SentDrive = parameter(
        SentDrive.CYCLE,
        "cycle: that of the leader in the cycle; host: that of the vehicle in the namespace of the node, at "
        "every decision, with its plan as path prediction, on the road of the cycle and initial_gap_m ahead "
        "of its own position",
    )
    initial_gap_m: float = declared(BridgeNodeParameters, "initial_gap_m")
    to_address: str = parameter(LOCALHOST, "address that the messages are sent to")
    to_port: int = declared(CamSettings, "cam_port", minimum=1)
    follow_clock: bool = parameter(
        default=True,
        description="send at every tick of the clock, with a mark at its end (lock-step); false sends by "
        "the clock of the computer, from the start of the node on",
    )
    trip_start_timestamp_ms: int = declared(CamSettings, "trip_start_timestamp_ms")

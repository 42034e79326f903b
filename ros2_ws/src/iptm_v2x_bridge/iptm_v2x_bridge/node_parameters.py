"""Parameters of the bridge and of the sender."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.braking import RangeSensorSettings
from iptm_core.declaration import TextEnum, declared, parameter
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.settings import (
    FrameSettings,
    ModelSettings,
    RoadSettings,
    TickSettings,
    TripSettings,
)
from iptm_core.state import NS_PER_S
from iptm_v2x_bridge.settings import LOCALHOST, CamSettings, LeaderSettings, SenderSettings


@dataclass(frozen=True)
class BridgeNodeParameters(
    RangeSensorSettings,
    LeaderSettings,
    FrameSettings,
    TickSettings,
    ModelSettings,
    RoadAheadSettings,
    TripSettings,
):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    initial_gap_m: float = parameter(
        15.0, "position of the leader at t = 0, the ego vehicle being at 0", "m", 1.0, 500.0
    )
    start_time_s: float = parameter(
        0.0,
        "cycle: trip time at which a trip that starts from a saved state is taken up; predictions of the "
        "ticks before are known then",
        "s",
        0.0,
        1e6,
    )

    @property
    def earlier_ticks_ns(self) -> range:
        """Ticks before the one at which the trip is taken up, in integer nanoseconds."""
        return range(0, round(self.start_time_s * NS_PER_S), round(self.period_s * NS_PER_S))


class SentDrive(TextEnum):
    """Drive that the sender sends."""

    CYCLE = "cycle"
    """The leader in the cycle."""
    EGO = "ego"
    """The vehicle whose topics it hears, with its plan as path prediction."""


@dataclass(frozen=True)
class SenderNodeParameters(SenderSettings, TickSettings, RoadSettings):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    sent_drive: SentDrive = parameter(
        SentDrive.CYCLE,
        "cycle: the leader in the cycle; ego: the vehicle in the namespace of the node, at "
        "every decision, with its plan as path prediction, on the road of the cycle and initial_gap_m ahead "
        "of its own position",
    )
    initial_gap_m: float = declared(BridgeNodeParameters, "initial_gap_m")
    to_address: str = parameter(LOCALHOST, "address that the messages are sent to")
    to_port: int = declared(CamSettings, "cam_port", minimum=1)
    follow_clock: bool = parameter(
        default=True,
        description="send at every tick of the clock, with a mark at its end (lock-step); false sends by "
        "the clock of the computer, from drive_began_s on",
    )
    drive_began_s: float = parameter(
        0.0,
        "follow_clock false: Unix time at which the drive began; 0: with the start of the node",
        "s",
        0.0,
        1e11,
    )
    trip_start_timestamp_ms: int = declared(CamSettings, "trip_start_timestamp_ms")

"""Settings of the sender: what it tells, how often, and what the link makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from iptm_core.declaration import Settings, parameter
from iptm_core.settings import MAX_SEED


class Framing(str, Enum):
    """What stands around a message in its datagram."""

    BARE = "bare"
    GEONETWORKING = "geonetworking"

    def __str__(self) -> str:
        """Return the bare word, as it is written in a file."""
        return str(self.value)


class Foresight(str, Enum):
    """What the sender tells of its future."""

    NONE = "none"
    """Nothing: a message of the first release."""
    PATH = "path"
    """Its path with times: the path prediction of the second release."""

    def __str__(self) -> str:
        """Return the bare word, as it is written in a file."""
        return str(self.value)


@dataclass(frozen=True)
class SenderSettings(Settings):
    """What is sent."""

    rate_hz: float = parameter(10.0, "messages per second of trip time", "Hz", 0.1, 100.0)
    foresight: Foresight = parameter(
        Foresight.PATH, "path: with path prediction (release 2), none: without (release 1)"
    )
    path_points: int = parameter(40, "points of a predicted path", "", 1, 40)
    path_length_s: float = parameter(60.0, "how far a predicted path reaches", "s", 1.0, 480.0)
    framing: Framing = parameter(
        Framing.GEONETWORKING, "geonetworking: with its headers and BTP-B, bare: the message alone"
    )
    station_id: int = parameter(4711, "identity of the sender", "", 0, 2**32 - 1)
    vehicle_length_m: float = parameter(
        4.5, "length of the sender, front to rear bumper", "m", 0.1, 102.0
    )
    link_delay_s: float = parameter(0.0, "delay of every message on its way", "s", 0.0, 60.0)
    link_jitter_s: float = parameter(
        0.0, "mean of an exponential delay on top of it", "s", 0.0, 10.0
    )
    loss_probability: float = parameter(0.0, "share of the messages lost", "", 0.0, 1.0)
    sender_seed: int = parameter(0, "seed of loss and jitter", "", 0, MAX_SEED)

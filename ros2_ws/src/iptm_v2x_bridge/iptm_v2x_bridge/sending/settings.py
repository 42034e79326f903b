"""Settings of the sender: content and rate of its messages, and the link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ParameterError
from iptm_core.settings import MAX_SEED, VEHICLE_LENGTH_M, VEHICLE_LENGTHS_M
from iptm_core.state import FloatArray


class Framing(TextEnum):
    """What stands around a message in its datagram."""

    BARE = "bare"
    GEONETWORKING = "geonetworking"


class Foresight(TextEnum):
    """Announced future of the sender."""

    NONE = "none"
    """Nothing: a message of the first release."""
    PATH = "path"
    """Its path with times: the path prediction of the second release."""


class Impostor(TextEnum):
    """A second sender with the identity of the first, whose motion it repeats until its departure."""

    NONE = "none"
    KEEPS_SPEED = "keeps_speed"
    """Drives on at the speed that it has then."""
    DRIFTS_ASIDE = "drifts_aside"
    """As before, and moves to the left by 1 m/s, out of the lane."""


MAX_POINT_INTERVAL_S = 12.6
"""Longest time between two points of a path on the wire."""


@dataclass(frozen=True)
class SenderSettings(Settings):
    """What is sent.

    Raises:
        ParameterError: a value is out of range, or too few points for the length of the path.
    """

    rate_hz: float = parameter(10.0, "messages per second of trip time", "Hz", 0.1, 100.0)
    foresight: Foresight = parameter(
        Foresight.PATH, "path: with path prediction (release 2), none: without (release 1)"
    )
    path_points: int = parameter(40, "points of a predicted path", "", 1, 40)
    path_length_s: float = parameter(60.0, "how far a predicted path reaches", "s", 1.0, 480.0)
    path_period_s: float = parameter(
        0.5, "time between two messages that carry a path; those between carry none", "s", 0.0, 60.0
    )
    framing: Framing = parameter(
        Framing.GEONETWORKING, "geonetworking: with its headers and BTP-B, bare: the message alone"
    )
    station_id: int = parameter(4711, "identity of the sender", "", 0, 2**32 - 1)
    vehicle_length_m: float = parameter(
        VEHICLE_LENGTH_M, "length of the sender, front to rear bumper", "m", *VEHICLE_LENGTHS_M
    )
    position_accuracy_m: float = parameter(
        0.02,
        "95 % bound of its own position that the sender states; its messages have the exact one",
        "m",
        0.01,
        40.93,
    )
    link_delay_s: float = parameter(0.0, "delay of every message on its way", "s", 0.0, 60.0)
    link_jitter_s: float = parameter(
        0.0, "mean of an exponential delay on top of it", "s", 0.0, 10.0
    )
    loss_probability: float = parameter(0.0, "share of the messages lost", "", 0.0, 1.0)
    sender_seed: int = parameter(0, "seed of loss and jitter", "", 0, MAX_SEED)
    impostor: Impostor = parameter(
        Impostor.NONE,
        "second sender with the same identity and settings: none, keeps_speed or drifts_aside",
    )
    impostor_departure_s: float = parameter(
        60.0, "trip time at which the impostor departs from the motion of the leader", "s", 0.0, 1e6
    )
    impostor_clock_ahead_s: float = parameter(
        0.0, "how far the clock of the impostor is ahead", "s", -2.0, 2.0
    )
    impostor_delay_s: float = parameter(
        0.01,
        "additional delay of the messages of the impostor; negative: they arrive first",
        "s",
        -1.0,
        1.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        longest_s = max(np.diff(path_times_s(self.path_points, self.path_length_s), prepend=0.0))
        if longest_s > MAX_POINT_INTERVAL_S:
            raise ParameterError(
                f"path_points is {self.path_points} for a path of {self.path_length_s:g} s; allowed: "
                f"points at most {MAX_POINT_INTERVAL_S:g} s apart"
            )


def path_times_s(points: int, length_s: float) -> FloatArray:
    """Return the times of the points of a predicted path, in whole tenths of a second as on the wire.

    Half of the points lie in the first third of the time, where the gap depends on them.
    """
    near = points // 2
    first = length_s / 3.0 * np.arange(1, near + 1) / max(near, 1)
    start_s = length_s / 3.0 if near else 0.0
    rest = start_s + (length_s - start_s) * np.arange(1, points - near + 1) / (points - near)
    tenths = np.unique(np.rint(10.0 * np.concatenate([first, rest])))
    times: FloatArray = tenths[tenths > 0.0] / 10.0
    return times

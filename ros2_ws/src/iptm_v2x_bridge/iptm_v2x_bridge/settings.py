"""Settings of the lead vehicle and its preview, and of the sender of its messages.

The former are a group of a trip and parameters of the bridge node.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ParameterError
from iptm_core.road_ahead import LeaderSourceSettings
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import (
    MAX_SEED,
    VEHICLE_LENGTH_M,
    VEHICLE_LENGTHS_M,
    PreviewSettings,
    VehicleAheadSettings,
)
from iptm_core.state import FloatArray

if TYPE_CHECKING:
    from iptm_v2x_bridge.bridge import TickBridge
    from iptm_v2x_bridge.cam_bridge import CamBridge
    from iptm_v2x_bridge.its import ReportingBridge, RoadsideRules, Verification
    from iptm_v2x_bridge.prediction.predictor import LeaderPredictor
    from iptm_v2x_bridge.prediction.road_rules import RoadRules
    from iptm_v2x_bridge.range_sensor import RangeSensorBridge


DEFAULT_CAM_PORT = 8947
LOCALHOST = "127.0.0.1"


class Expectation(TextEnum):
    """The expectation for a leader of whose future nothing is known."""

    HISTORY = "history"
    """Its acceleration decays."""
    REGRESSION = "regression"
    """What other drivers did after the same seconds."""


@dataclass(frozen=True)
class CamSettings(Settings):
    """The leader observed by its messages, and what is expected of it where they state nothing."""

    cam_address: str = parameter(
        LOCALHOST, "cam: own address to listen at; 0.0.0.0 listens to the whole network"
    )
    cam_port: int = parameter(DEFAULT_CAM_PORT, "cam: UDP port to listen at", "", 0, 65_535)
    cam_lock_step: bool = parameter(
        default=True,
        description="cam: wait at every tick for a sender that follows the clock (scripts/iptm send); false "
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
    datagram_offset_bytes: int = parameter(
        0,
        "cam: length of what a receiver puts in front of every message or packet, 78 for the example of "
        "Cohda's MK5",
        "",
        0,
        1000,
    )
    cam_topic: str = parameter(
        "",
        "cam: hear messages of cars on this topic instead of the socket (etsi_its_cam_msgs/msg/CAM, where "
        "that package is installed); with cam_lock_step false",
    )
    compare_altitudes: bool = parameter(
        default=False,
        description="cam: a car whose altitude contradicts the height of the road (of the track in cycle or "
        "slope) by more than its error does not lead",
    )
    height_datum_m: float = parameter(
        0.0,
        "cam: height of the zero of the track's heights above the WGS84 ellipsoid, which altitudes in "
        "messages refer to; about 47 in Germany for heights above sea level",
        "m",
        -1000.0,
        1000.0,
    )
    trust_anchors: str = parameter(
        "",
        "cam: folder with certificates of trusted authorities (.oer, .cert): signatures are verified, and "
        "messages refused whose signature is wrong or whose signer none of them vouches for (needs "
        "requirements/security.txt)",
    )
    refuse_unverified: bool = parameter(
        default=False,
        description="cam: refuse messages, too, that are not signed or in a way that cannot be verified",
    )
    recorded_packets: str = parameter(
        "",
        "cam: read recorded packets instead of the socket: a bag with v2x/datagrams, or a capture (.pcap, "
        ".pcapng; of UDP datagrams those to cam_port)",
    )
    publish_datagrams: bool = parameter(
        default=False,
        description="cam: publish every datagram on v2x/datagrams, so that a bag holds the radio traffic",
    )

    prediction: Expectation = parameter(
        Expectation.HISTORY,
        "cam: expected motion of a leader that sends no path: history (its acceleration decays) or "
        "regression (on its last 10 s)",
    )
    regression_model: str = parameter(
        "",
        "cam: file with the regression, written by scripts/iptm train; empty: the shipped one",
    )
    earlier_drives: str = parameter(
        "",
        "cam: earlier drives of this road to learn from, as in cycle, separated by commas",
    )
    roadside_messages: bool = parameter(
        default=False,
        description="cam: take signals from the messages of roadside stations, too (SPATEM, MAPEM; needs "
        "requirements/roadside.txt); they override the given ones",
    )
    chain_ahead: bool = parameter(
        default=False,
        description="range_sensor, cam: forecast the leader by the vehicle ahead of it (second track of the "
        "sensor, messages) and by the signals and limits that it comes to",
    )
    leader_keeps_rules: bool = parameter(
        default=True,
        description="cam: the prediction obeys the known speed limits and signals",
    )

    def road_of_messages(self, road: RoadLine) -> RoadLine:
        """Return a road with its heights above the ellipsoid, or without if they are not to be compared."""
        heights_m = road.heights_m
        if not self.compare_altitudes or heights_m is None:
            return replace(road, heights_m=None)
        return replace(road, heights_m=heights_m + self.height_datum_m)

    def build_verifier(self) -> Verification:
        """Return what verifies signatures.

        Raises:
            ParameterError: the extra, its library or a certificate is missing.
        """
        from iptm_v2x_bridge.its import Unverified, extra_for  # noqa: PLC0415

        if self.refuse_unverified and not self.trust_anchors:
            raise ParameterError(
                "refuse_unverified is True, but trust_anchors is ''; allowed: a folder with certificates"
            )
        if not self.trust_anchors:
            return Unverified()
        extra = extra_for("trust_anchors", self.trust_anchors)
        found: Verification = extra.verifier(
            self.trust_anchors, refuses_unverified=self.refuse_unverified
        )
        return found

    def build_heard_rules(self, given: RoadRules, road: RoadLine) -> RoadsideRules | None:
        """Return the rules as they are heard, None where they are not to be.

        Raises:
            ParameterError: the extra, or the codec of these messages, is not installed.
        """
        if not self.roadside_messages:
            return None
        from iptm_v2x_bridge.its import extra_for  # noqa: PLC0415

        found: RoadsideRules = extra_for("roadside_messages", value=True).roadside_rules(
            road, given
        )
        return found

    def build_chain(
        self,
        inner: TickBridge,
        preview: PreviewSettings,
        sensor: RangeSensorBridge | None,
        messages: CamBridge | None = None,
        rules: tuple[RoadRules, RoadRules] | None = None,
    ) -> ReportingBridge:
        """Return a bridge that forecasts the leader by the vehicles ahead of it.

        Args:
            inner: the bridge of sensor and messages.
            preview: length and step of the previews.
            sensor: has the second track; None without.
            messages: has the stations; None without.
            rules: rules of the road that are likely, and that are sure; None for none.

        Raises:
            ParameterError: the extra is not installed.
        """
        from iptm_v2x_bridge.its import extra_for  # noqa: PLC0415

        found: ReportingBridge = extra_for("chain_ahead", value=True).chain(
            inner, preview, sensor=sensor, messages=messages, rules=rules
        )
        return found

    def build_predictors(self, route: Route, rules: RoadRules) -> tuple[LeaderPredictor, ...]:
        """Return the predictors, the best informed first.

        Raises:
            IptmError: a file is not usable.
        """
        from iptm_v2x_bridge.prediction.expected_motion import History, LearntProfile  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.predictor import ReceivedPath  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.road_rules import BoundedByRules  # noqa: PLC0415

        usual: LeaderPredictor = History()
        if self.prediction is Expectation.REGRESSION:
            usual = Regression(RegressionModel.load(self.regression_model))
        found: list[LeaderPredictor] = [ReceivedPath()]
        names = [name.strip() for name in self.earlier_drives.split(",") if name.strip()]
        if names:
            gap_m = route.leader.start_position_m
            drives = [build_route(name, initial_gap_m=gap_m).leader for name in names]
            found.append(LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in drives]))
        if self.leader_keeps_rules:
            found.append(BoundedByRules(usual, rules))
        return (*found, usual)


@dataclass(frozen=True)
class LeaderSettings(VehicleAheadSettings, CamSettings, PreviewSettings, LeaderSourceSettings):
    """The lead vehicle, its messages, and the preview of its motion."""

    leader_length_m: float = parameter(
        VEHICLE_LENGTH_M,
        "vehicle: length of the leader, front to rear bumper",
        "m",
        *VEHICLE_LENGTHS_M,
    )


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


MAX_POINT_INTERVAL_S = 12.6
"""Longest time between two points of a path on the wire."""


@dataclass(frozen=True)
class SenderSettings(Settings):
    """Settings of the messages.

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

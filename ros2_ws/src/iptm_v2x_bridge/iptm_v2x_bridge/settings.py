"""What is chosen about the lead vehicle; a group of a trip, and parameters of the bridge node."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ParameterError
from iptm_core.road_ahead import LeaderSourceSettings
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import (
    VEHICLE_LENGTH_M,
    VEHICLE_LENGTHS_M,
    PreviewSettings,
    VehicleAheadSettings,
)

if TYPE_CHECKING:
    from iptm_v2x_bridge.messages.signatures import Verifier
    from iptm_v2x_bridge.prediction.predictor import Predictor
    from iptm_v2x_bridge.prediction.road_rules import RoadRules
    from iptm_v2x_bridge.roadside.table import RoadsideTable

DEFAULT_CAM_PORT = 8947
LOCALHOST = "127.0.0.1"


class Expectation(TextEnum):
    """What is expected of a leader of whose future nothing is known."""

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

    def build_verifier(self) -> Verifier:
        """Return what verifies signatures."""
        # Only a bridge that listens to a radio needs them.
        from iptm_v2x_bridge.messages.signatures import Verifier, read_anchors  # noqa: PLC0415

        if self.refuse_unverified and not self.trust_anchors:
            raise ParameterError(
                "refuse_unverified is True, but trust_anchors is ''; allowed: a folder with certificates"
            )
        anchors = read_anchors(self.trust_anchors) if self.trust_anchors else ()
        return Verifier(anchors, refuses_unverified=self.refuse_unverified)

    def build_heard_rules(self, given: RoadRules, road: RoadLine) -> RoadsideTable | None:
        """Return the rules as they are heard, None where they are not to be.

        Raises:
            ParameterError: the codec of these messages is not installed.
        """
        if not self.roadside_messages:
            return None
        from iptm_v2x_bridge.messages.pycrate_codec import specification  # noqa: PLC0415
        from iptm_v2x_bridge.roadside.table import RoadsideTable  # noqa: PLC0415

        specification()
        return RoadsideTable(road, given)

    def build_predictors(self, route: Route, rules: RoadRules) -> tuple[Predictor, ...]:
        """Return the predictors, the best informed first.

        Raises:
            IptmError: a file is not usable.
        """
        from iptm_v2x_bridge.prediction.extrapolation import History  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.received_path import ReceivedPath  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel  # noqa: PLC0415
        from iptm_v2x_bridge.prediction.road_rules import BoundedByRules  # noqa: PLC0415

        usual: Predictor = History()
        if self.prediction is Expectation.REGRESSION:
            usual = Regression(RegressionModel.load(self.regression_model))
        found: list[Predictor] = [ReceivedPath()]
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

"""Messages of etsi_its_cam_msgs, by stand-ins with the names of its fields: no wheel has the package."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import pytest
from tests.iptm_v2x_bridge import real_packets
from tests.iptm_v2x_bridge.cams import cam
from tests.iptm_v2x_bridge.radio import ROAD, station

from iptm_core.errors import MessageError, ParameterError
from iptm_ros.suite_node import SuiteNode
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import CamMessage, decode_cam, decode_fields, encode_cam
from iptm_v2x_bridge.messages.packets import MessageKind, OpenedDatagram, open_datagram
from iptm_v2x_bridge.messages.ros_cam import bits_of, message_type
from iptm_v2x_bridge.node_leader_answers import open_source
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.settings import CamSettings


def boxed(value: int) -> SimpleNamespace:
    return SimpleNamespace(value=value)


def measured(name: str, fields: dict[str, int]) -> SimpleNamespace:
    return SimpleNamespace(
        **{
            f"{name}_value": boxed(fields["value"]),
            f"{name}_confidence": boxed(fields["confidence"]),
        }
    )


def ros(payload: bytes) -> Any:
    """Return a message as etsi_its_conversion makes it of bits; names as in its .msg files."""
    fields = decode_fields("CAM", payload)
    basic, (kind, vehicle) = fields["params"]["basic"], fields["params"]["high"]
    place = basic["position"]
    high = SimpleNamespace(choice=int(kind != "vehicle"))
    if kind == "vehicle":
        high.basic_vehicle_container_high_frequency = SimpleNamespace(
            heading=measured("heading", vehicle["heading"]),
            speed=measured("speed", vehicle["speed"]),
            drive_direction=boxed(vehicle["direction"]),
            vehicle_length=SimpleNamespace(
                vehicle_length_value=boxed(vehicle["length"]["value"]),
                vehicle_length_confidence_indication=boxed(vehicle["length"]["trailer"]),
            ),
            vehicle_width=boxed(vehicle["width"]),
            longitudinal_acceleration=measured(
                "longitudinal_acceleration", vehicle["longitudinal"]
            ),
            lane_position=boxed(vehicle.get("lane", 0)),
            lane_position_is_present="lane" in vehicle,
        )
    return SimpleNamespace(
        header=SimpleNamespace(
            protocol_version=fields["header"]["protocolVersion"],
            message_id=fields["header"]["messageId"],
            station_id=boxed(fields["header"]["stationId"]),
        ),
        cam=SimpleNamespace(
            generation_delta_time=boxed(fields["deltaTime"]),
            cam_parameters=SimpleNamespace(
                basic_container=SimpleNamespace(
                    station_type=boxed(basic["stationType"]),
                    reference_position=SimpleNamespace(
                        latitude=boxed(place["lat"]),
                        longitude=boxed(place["lon"]),
                        position_confidence_ellipse=SimpleNamespace(
                            semi_major_confidence=boxed(place["ellipse"]["major"]),
                            semi_minor_confidence=boxed(place["ellipse"]["minor"]),
                            semi_major_orientation=boxed(place["ellipse"]["orientation"]),
                        ),
                        altitude=measured("altitude", place["altitude"]),
                    ),
                ),
                high_frequency_container=high,
            ),
        ),
    )


def payload_of(packet: bytes) -> bytes:
    opened = open_datagram(packet, (MessageKind.CAM,))
    assert isinstance(opened, OpenedDatagram)
    return opened.payload


@pytest.mark.parametrize("name", ["GOLF", "SNIFFED", "BRIDGED", "COHDA", "SALZBURG"])
def test_a_message_of_a_real_station_is_the_same_by_topic(name: str) -> None:
    payload = payload_of(getattr(real_packets, name))
    message = decode_cam(payload)
    assert isinstance(message, CamMessage)
    assert decode_cam(bits_of(ros(payload))) == message


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lane": None, "width_m": None, "length_m": None, "altitude_m": None},
        {"altitude_bound_m": 0.5},
        {"reversing": True, "trailer_of_unknown_length": True, "acceleration_m_s2": None},
        {"speed_m_s": 0.0, "heading_deg": None, "position_bound_m": None, "station_type": 8},
    ],
)
def test_every_field_that_counts_comes_along(changes: dict[str, Any]) -> None:
    message = cam(**changes)
    assert decode_cam(bits_of(ros(encode_cam(message)))) == message


def test_what_a_vehicle_does_not_say_is_incomplete_as_by_radio() -> None:
    message = ros(encode_cam(cam()))
    message.cam.cam_parameters.high_frequency_container.choice = 1
    assert decode_cam(bits_of(message)) is Rejection.INCOMPLETE


class Node:
    """Takes subscriptions, and keeps what is refused."""

    def __init__(self) -> None:
        self.subscriptions: dict[str, tuple[Any, Callable[[Any], None]]] = {}
        self.refused: list[str] = []

    def create_subscription(
        self, kind: Any, name: str, callback: Callable[[Any], None], depth: int
    ) -> None:
        assert depth > 0
        self.subscriptions[name] = (kind, callback)

    def guard(self, name: str, callback: Callable[[], None]) -> None:
        try:
            callback()
        except MessageError as error:
            self.refused.append(f"{name}: {error}")


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> type:
    """The package with the type."""
    module = ModuleType("etsi_its_cam_msgs.msg")
    kind = type("CAM", (), {})
    module.CAM = kind  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "etsi_its_cam_msgs", ModuleType("etsi_its_cam_msgs"))
    monkeypatch.setitem(sys.modules, "etsi_its_cam_msgs.msg", module)
    return kind


SETTINGS = CamSettings(cam_topic="/etsi_its_conversion/cam/out", cam_lock_step=False)


def test_a_car_heard_on_a_topic_leads_as_one_heard_by_radio(package: type) -> None:
    node = Node()
    source = open_source(SETTINGS, cast("SuiteNode", node))
    kind, hear = node.subscriptions["/etsi_its_conversion/cam/out"]
    assert kind is package
    by_topic, by_radio = CamBridge(ROAD), CamBridge(ROAD)
    for time_ms in range(0, 1001, 100):
        bits = encode_cam(station(4711, time_ms, 50.0 + 0.012 * time_ms, 12.0))
        hear(ros(bits))
        for received_ns, heard in source.take(None, time_ms * 10**6)[0]:
            assert by_topic.receive(heard, received_ns) is None
        by_radio.receive(bits, time_ms * 10**6)
    assert by_topic.answer(10**9, 0.0).leader == by_radio.answer(10**9, 0.0).leader is not None
    broken = ros(encode_cam(cam()))
    broken.cam.generation_delta_time.value = 70_000
    hear(broken)
    assert source.take(None, 10**9) == ([], 0)
    (refused,) = node.refused
    assert refused.startswith("/etsi_its_conversion/cam/out: CAM cannot be encoded")


@pytest.mark.usefixtures("package")
def test_a_topic_has_no_lock_step() -> None:
    with pytest.raises(ParameterError, match="cam_lock_step True"):
        open_source(CamSettings(cam_topic="/cam"), cast("SuiteNode", Node()))


def test_without_the_package_the_parameter_is_refused() -> None:
    with pytest.raises(ParameterError, match="apt install ros-jazzy-etsi-its-cam-msgs"):
        message_type()

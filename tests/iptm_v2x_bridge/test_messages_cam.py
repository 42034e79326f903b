"""Bits of cooperative awareness messages, and what they mean."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.iptm_v2x_bridge.cams import cam, path
from tests.iptm_v2x_bridge.random_cams import random_fields

from iptm_core.errors import MessageError
from iptm_v2x_bridge.messages.cam import (
    CamMessage,
    PredictedPath,
    decode_cam,
    decode_datagram,
    encode_cam,
    encode_fields,
    specification,
)
from iptm_v2x_bridge.messages.packets import HEADER_BYTES, MAX_DATAGRAM_BYTES, wrap
from iptm_v2x_bridge.rejections import Rejection

HERE = (600_000_000_123, (48.1234567, 10.7654321), 20.0)


def packet(payload: bytes) -> bytes:
    return wrap(payload, 4711, 5, *HERE)


def read(message: CamMessage) -> CamMessage:
    found = decode_cam(encode_cam(message))
    assert isinstance(found, CamMessage)
    return found


def optional(value: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | value


def steps(low: float, high: float, step: float) -> st.SearchStrategy[float]:
    """Values that the wire holds exactly."""
    scale = round(1.0 / step)
    return st.integers(round(low * scale), round(high * scale)).map(lambda count: count / scale)


@settings(deadline=None, max_examples=150)
@given(
    st.builds(
        CamMessage,
        station_id=st.integers(0, 2**32 - 1),
        delta_time_ms=st.integers(0, 65_535),
        latitude_deg=steps(-90.0, 90.0, 1e-7),
        longitude_deg=steps(-180.0, 180.0, 1e-7),
        heading_deg=steps(0.0, 359.9, 0.1),
        speed_m_s=steps(0.0, 163.8, 0.01),
        reversing=st.booleans(),
        acceleration_m_s2=optional(steps(-16.0, 16.0, 0.1)),
        length_m=optional(steps(0.1, 102.1, 0.1)),
        trailer_of_unknown_length=st.booleans(),
        width_m=optional(steps(0.1, 6.0, 0.1)),
        altitude_m=optional(steps(-1000.0, 8000.0, 0.01)),
        position_bound_m=optional(steps(0.0, 40.9, 0.01)),
        lane=optional(st.integers(0, 14)),
        station_type=st.integers(3, 11),
    )
)
def test_what_is_sent_is_what_is_read(message: CamMessage) -> None:
    assert read(message) == message


def test_a_predicted_path_arrives_with_its_times() -> None:
    sent = cam(path=path())
    found = read(sent).path
    assert found is not None
    assert found.confidence == 0.8
    np.testing.assert_allclose(found.times_s, path().times_s, atol=1e-9)
    np.testing.assert_allclose(found.latitudes_deg, path().latitudes_deg, atol=1e-9)


def test_rounding_of_a_path_does_not_add_up() -> None:
    """Every point lies within half a unit of the wire, the fortieth too."""
    latitudes = 48.1234567 + 1.4e-8 * np.arange(1, 41)
    sent = PredictedPath(path().times_s, latitudes, path().longitudes_deg)
    found = read(cam(path=sent)).path
    assert found is not None
    assert np.abs(found.latitudes_deg - latitudes).max() <= 0.5e-7 + 1e-12


def test_the_wire_is_as_long_as_the_standard_makes_it() -> None:
    assert len(encode_cam(cam(lane=None))) == 41
    assert len(encode_cam(cam(path=path()))) < 400


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"speed_m_s": 500.0}, "speed"),
        ({"delta_time_ms": 65_536}, "deltaTime"),
        ({"station_id": -1}, "stationId"),
        ({"path": path(points=41)}, "points"),
        ({"path": path(points=2, step_s=20.0)}, "deltaTime"),
    ],
)
def test_what_the_wire_cannot_hold_is_refused(changes: dict[str, Any], name: str) -> None:
    with pytest.raises(MessageError, match=name):
        encode_cam(cam(**changes))


def test_a_packet_carries_the_same_message_and_its_time() -> None:
    bare = encode_cam(cam())
    assert decode_datagram(bare) == (cam(), None)
    assert decode_datagram(packet(bare)) == (cam(), 600_000_000_123 % 2**32)


def changed(datagram: bytes, index: int, value: int) -> bytes:
    return datagram[:index] + bytes([value]) + datagram[index + 1 :]


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"", Rejection.SIZE),
        (bytes(6), Rejection.SIZE),
        (encode_cam(cam()) + bytes(MAX_DATAGRAM_BYTES), Rejection.SIZE),
        (bytes(100), Rejection.PACKET),
        (changed(encode_cam(cam()), 1, 1), Rejection.HEADER),
        (changed(encode_cam(cam()), 0, 1), Rejection.PACKET),
        (encode_cam(cam())[:20], Rejection.DECODING),
        (packet(encode_cam(cam()))[:-1], Rejection.PACKET),
        (packet(encode_cam(cam())) + b"\0", Rejection.PACKET),
        (changed(packet(encode_cam(cam())), 0, 0x12), Rejection.SECURED),
        (changed(packet(encode_cam(cam())), 4, 0x10), Rejection.PACKET),
        (changed(packet(encode_cam(cam())), HEADER_BYTES - 3, 0xD2), Rejection.PORT),
        (packet(changed(encode_cam(cam()), 1, 1)), Rejection.HEADER),
    ],
)
def test_each_refusal_has_its_reason(datagram: bytes, reason: Rejection) -> None:
    assert decode_datagram(datagram) is reason


@pytest.mark.parametrize(
    ("where", "value"),
    [("speed", 16_383), ("speed", 16_382), ("heading", 3601), ("lat", 900_000_001)],
)
def test_a_message_without_the_essentials_is_incomplete(where: str, value: int) -> None:
    fields = specification().decode("CAM", encode_cam(cam()))
    if where == "lat":
        fields["params"]["basic"]["position"]["lat"] = value
    else:
        fields["params"]["high"][1][where]["value"] = value
    assert decode_cam(encode_fields("CAM", fields)) is Rejection.INCOMPLETE


def test_a_path_without_times_is_no_prediction() -> None:
    """Its points say where, not when."""
    fields = specification().decode("CAM", encode_cam(cam()))
    point = {"lat": 100, "lon": 0}
    content = {"paths": [{"points": [point], "usage": "navigation", "confidence": 101}]}
    data = encode_fields("PathPrediction", content)
    fields["params"]["extensions"] = [{"id": 4, "data": data}]
    found = decode_cam(encode_fields("CAM", fields))
    assert isinstance(found, CamMessage)
    assert found.path is None


def test_a_damaged_path_condemns_its_message() -> None:
    fields = specification().decode("CAM", encode_cam(cam()))
    fields["params"]["extensions"] = [{"id": 4, "data": b"\xff\xff"}]
    assert decode_cam(encode_fields("CAM", fields)) is Rejection.DECODING


@pytest.mark.parametrize(
    ("station_type", "leads"),
    [(0, True), (1, False), (2, False), (5, True), (12, True), (13, True), (14, True), (15, False)],
)
def test_whatever_may_be_ahead_on_the_road_leads(station_type: int, leads: bool) -> None:
    """TS 102 894-2: unknown, light vehicles, animals and tractors as well; not people and roadside units."""
    bits = encode_cam(cam(station_type=station_type))
    assert isinstance(decode_cam(bits), CamMessage) == leads


def test_containers_of_no_interest_do_not_disturb() -> None:
    source = random.Random(3)  # noqa: S311 - no secret
    for _ in range(200):
        fields = random_fields(source)
        found = decode_cam(encode_fields("CAM", fields))
        if isinstance(found, CamMessage):
            assert found.station_id == fields["header"]["stationId"]
            assert found.speed_m_s == fields["params"]["high"][1]["speed"]["value"] / 100.0
        else:
            assert found is Rejection.INCOMPLETE


def test_the_rear_of_an_unknown_trailer_is_taken_to_be_near() -> None:
    assert cam(length_m=4.0).front_to_rear_m == 4.0
    assert replace(cam(length_m=4.0), trailer_of_unknown_length=True).front_to_rear_m > 15.0
    assert cam(length_m=None).front_to_rear_m > 3.0


@pytest.mark.parametrize("speed_m_s", [0.0, 2.9, 3.0, 20.0])
def test_a_heading_may_be_missing_at_low_speed(speed_m_s: float) -> None:
    message = cam(heading_deg=None, speed_m_s=speed_m_s)
    assert decode_cam(encode_cam(message)) == (message if speed_m_s < 3.0 else Rejection.INCOMPLETE)

"""What surrounds messages on real radios: security envelopes, BTP-B alone, headers of receivers."""

from __future__ import annotations

import struct

import pytest
from tests.iptm_v2x_bridge import real_packets
from tests.iptm_v2x_bridge.cams import cam
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import CamMessage, decode_cam, encode_cam
from iptm_v2x_bridge.messages.packets import (
    CAM_PORT,
    HEADER_BYTES,
    MessageKind,
    OpenedDatagram,
    open_datagram,
    signed_octets,
    wrap,
)
from iptm_v2x_bridge.rejections import Rejection

SECURED = real_packets.SALZBURG
ENVELOPE = SECURED[4:]
KINDS = (MessageKind.CAM,)


def packet(message: bytes) -> bytes:
    return wrap(message, 4711, 5, 600_000_000_123, (0.0, 0.0))


def opened(datagram: bytes) -> OpenedDatagram:
    found = open_datagram(datagram, KINDS)
    assert isinstance(found, OpenedDatagram), found
    return found


@pytest.mark.parametrize(
    ("name", "bound_m"),
    [
        ("SALZBURG", 2.18),
        ("GOLF", 2.9),
        ("GOLF_EARLIER", 2.86),
        ("SNIFFED", 16.44),
        ("BRIDGED", 2.82),
        ("COHDA", 8.53),
        ("COHDA_LATER", 8.55),
    ],
)
def test_signed_messages_of_real_stations_are_read(name: str, bound_m: float) -> None:
    found = opened(getattr(real_packets, name))
    assert found.secured
    message = decode_cam(found.payload)
    assert isinstance(message, CamMessage)
    assert message.position_bound_m == bound_m
    # The header of the packet states the same in another encoding, up to 1 s apart.
    header = signed_octets(found.envelope)
    assert header is not None
    address, at_ms, latitude, longitude, speed, heading = struct.unpack_from("!4xIIiiHH", header, 8)
    assert found.packet_timestamp_ms == at_ms
    assert message.station_id == address
    assert message.latitude_deg == pytest.approx(1e-7 * latitude, abs=1e-4)
    assert message.longitude_deg == pytest.approx(1e-7 * longitude, abs=1e-4)
    assert message.speed_m_s == pytest.approx(((speed & 0x7FFF) % 0x4000) / 100.0, abs=2.0)
    assert message.heading_deg == pytest.approx(heading / 10.0, abs=5.0)


def test_a_signed_warning_of_a_roadside_station_is_of_no_kind_that_is_read() -> None:
    assert open_datagram(real_packets.WARNING, KINDS) is Rejection.PORT


def test_an_envelope_around_a_message_of_our_own() -> None:
    plain = packet(encode_cam(cam()))
    signed = plain[4:]
    envelope = b"\x03\x81\x00\x40\x03\x80" + bytes((0x81, len(signed))) + signed + b"\x40\x01\x24"
    found = opened(bytes((0x12,)) + plain[1:4] + envelope)
    assert (found.payload, found.secured) == (opened(plain).payload, True)
    assert not opened(plain).secured


@pytest.mark.parametrize(
    "envelope",
    [
        b"",
        ENVELOPE[:5],
        ENVELOPE[:60],
        b"\x02" + ENVELOPE[1:],
        b"\x03\x82" + ENVELOPE[2:],
        b"\x03\x81\x00\x20" + ENVELOPE[4:],
        ENVELOPE[:6] + b"\x83\x00\x00\x10" + bytes(40),
        ENVELOPE[:6] + b"\x80" + bytes(40),
        ENVELOPE[:6] + b"\x81",
    ],
)
def test_what_is_no_envelope_around_data_is_refused_as_secured(envelope: bytes) -> None:
    assert signed_octets(envelope) in {None, b""}
    assert open_datagram(bytes((0x12, 0, 5, 1)) + envelope, KINDS) in {
        Rejection.SECURED,
        Rejection.PACKET,
        Rejection.SIZE,
    }


def test_a_message_behind_its_port_alone() -> None:
    message = encode_cam(cam())
    framed = CAM_PORT.to_bytes(2, "big") + bytes(2) + message
    assert opened(framed) == OpenedDatagram(MessageKind.CAM, message)
    assert packet(message)[HEADER_BYTES - 4 :] == framed
    other = (2002).to_bytes(2, "big") + bytes(2) + message
    assert open_datagram(other, KINDS) is Rejection.PACKET


def test_what_a_receiver_puts_in_front_is_skipped() -> None:
    message = encode_cam(cam())
    bare, behind = CamBridge(ROAD), CamBridge(ROAD, datagram_offset_bytes=78)
    assert bare.receive(message, 0) == behind.receive(bytes(78) + message, 0)
    assert bare.report() == behind.report()
    assert behind.receive(message, 0) is Rejection.SIZE


def test_messages_without_a_verified_signature_are_counted() -> None:
    bridge = CamBridge(ROAD)
    bridge.receive(encode_cam(cam()), 0)
    assert bridge.report()["signatures_not_verified"] == 0
    bridge.receive(SECURED, 0)
    assert bridge.report()["signatures_not_verified"] == 1

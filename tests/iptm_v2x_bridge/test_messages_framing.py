"""What surrounds messages on real radios: security envelopes, BTP-B alone, headers of receivers."""

from __future__ import annotations

import pytest
from tests.iptm_v2x_bridge.cams import cam
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.messages.cam_codec import decode_cam, encode_cam
from iptm_v2x_bridge.messages.geonetworking import (
    CAM_PORT,
    HEADER_BYTES,
    SenderPosition,
    wrap,
)
from iptm_v2x_bridge.messages.its_pdu import MessageKind, OpenedDatagram, open_datagram
from iptm_v2x_bridge.messages.security_envelope import signed_octets
from iptm_v2x_bridge.rejections import Rejection

# A CAM with signature and certificate, sent in Salzburg; it stands in the public tests of the ASN.1
# compiler rasn (github.com/librasn/compiler, IEEE 1609.2). A basic header is put in front.
ENVELOPE = bytes.fromhex(
    "0381004003805f20500280003b010014001e0ddf3f5b7da06f53ac1c81287c07c5e02f801409f60000000007d100000202df3f5b7d53"
    "ac405a44c22f8e61f645e1b41b400047f190489f7fa00aa4bfe9ea8333ff01fffa00283300001bfc28fe4f34bc7fff00c00124000234"
    "f2b2e032de0205800501017ce7f9810101800300805d5dcbeefbe7d22d3083000000000024bd2d05860001e001078001248104030"
    "1fffc80012581050401ffffff80018c81050402ffffe000018d8002027e810201018002027f81020101000203ff808082dea08ea8e83e"
    "46244a8f98a1df151e938d2639acdaa410804880aa362e855dad81835bd800fce37f7070dff59027a39d19ae8de9607612cbb2309af5"
    "fe89433008028e294ff7efaecabf824cab932704cb982080f342900c1fda11f6da434005ed8580822f0e6198a844841fe9f39d5a03fd"
    "41121ecb45d6d6d6c548da1e55b0bc377cfa4c08bc73c2820943302a81124fcf139ea47e41ee6eb6cde71e0813185998abd5"
)
SECURED = bytes((0x12, 0, 5, 1)) + ENVELOPE
KINDS = (MessageKind.CAM,)


def packet(message: bytes) -> bytes:
    return wrap(message, SenderPosition(600_000_000_123, 0, 0, 0, 0), 4711, 5)


def opened(datagram: bytes) -> OpenedDatagram:
    found = open_datagram(datagram, KINDS)
    assert isinstance(found, OpenedDatagram), found
    return found


def test_a_signed_message_of_a_real_car_is_read_and_marked() -> None:
    found = opened(SECURED)
    assert found.secured
    message = decode_cam(found.payload)
    assert isinstance(message, CamMessage)
    assert message.station_id == 0xDF3F5B7D
    # The sender's position in the header of the packet.
    assert message.latitude_deg == pytest.approx(47.8226556, abs=1e-4)
    assert message.longitude_deg == pytest.approx(13.0408495, abs=1e-4)
    assert found.packet_timestamp_ms == 0xA06F53AC


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

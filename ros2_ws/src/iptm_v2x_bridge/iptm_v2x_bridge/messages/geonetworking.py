"""Broadcast packets of GeoNetworking with BTP-B: the headers in front of a message on the air.

EN 302 636-4-1 (basic and common header, long position vector; single-hop and geographic broadcast) and
EN 302 636-5-1 (BTP-B). Cars send to their neighbours, roadside stations often to everyone in an area. The
envelope of a secured packet is removed; whether its signature is right is asked elsewhere.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from iptm_v2x_bridge.messages.security_envelope import signed_octets
from iptm_v2x_bridge.rejections import Rejection

CAM_PORT = 2001
TIMESTAMP_MODULUS_MS = 2**32

_BASIC = struct.Struct("!BBBB")
_COMMON = struct.Struct("!BBBBHBB")
_POSITION = struct.Struct("!H6sIiiHH")
_BTP = struct.Struct("!HH")
_START = _BASIC.size + _COMMON.size

_VERSION_1, _NEXT_COMMON, _NEXT_SECURED = 0x10, 1, 2
_NEXT_BTP_B, _SINGLE_HOP = 2, 0x50
_AROUND_POSITION = {_SINGLE_HOP: (0, 4)} | dict.fromkeys((0x40, 0x41, 0x42), (4, 16))
"""Bytes before and behind the position vector in the extended headers that are read: nothing and what is
reserved, or the number of the packet and the area (circle, rectangle, ellipse)."""
HEADER_BYTES = _START + _POSITION.size + 4 + _BTP.size
"""Length of the headers of a single-hop broadcast."""
_LIFETIME_1_S = (1 << 2) | 1  # multiplier 1 of the base "1 s"
_STATION_MOVES, _POSITION_ACCURATE, _ADDRESS_BY_HAND = 0x80, 0x8000, 0x8000
_ROADSIDE_UNIT = 15
_CLASS_2 = 2  # traffic class of awareness messages


@dataclass(frozen=True)
class SenderPosition:
    """Long position vector of the sender, as integers of the wire.

    Attributes:
        timestamp_ms: TimestampIts of the position, all of it or modulo 2^32.
        latitude: 1e-7 degrees.
        longitude: 1e-7 degrees.
        speed_cm_s: speed in cm/s.
        heading: 0.1 degrees, clockwise from north.
    """

    timestamp_ms: int
    latitude: int
    longitude: int
    speed_cm_s: int
    heading: int


@dataclass(frozen=True)
class Packet:
    """A message with the time of its packet.

    Attributes:
        payload: the message.
        port: BTP port that it was sent to.
        timestamp_ms: TimestampIts of the sender's position modulo 2^32.
        envelope: security envelope around its headers and it, empty without one; it has not been verified.
    """

    payload: bytes
    port: int
    timestamp_ms: int
    envelope: bytes = b""


def wrap(
    payload: bytes,
    sender: SenderPosition,
    station_id: int,
    station_type: int,
    port: int = CAM_PORT,
) -> bytes:
    """Return a single-hop broadcast of a message.

    Args:
        payload: the message.
        sender: where and when.
        station_id: its lower bytes become the sender's link-layer address, locally administered.
        station_type: type of the station, 5 for a passenger car.
        port: BTP port of the service, that of cooperative awareness unless stated.
    """
    length = _BTP.size + len(payload)
    address = _ADDRESS_BY_HAND | (station_type & 0x1F) << 10
    link_layer = b"\x02\x00" + struct.pack("!I", station_id % 2**32)
    flags = 0 if station_type == _ROADSIDE_UNIT else _STATION_MOVES
    return b"".join(
        (
            _BASIC.pack(_VERSION_1 | _NEXT_COMMON, 0, _LIFETIME_1_S, 1),
            _COMMON.pack(_NEXT_BTP_B << 4, _SINGLE_HOP, _CLASS_2, flags, length, 1, 0),
            _POSITION.pack(
                address,
                link_layer,
                sender.timestamp_ms % TIMESTAMP_MODULUS_MS,
                sender.latitude,
                sender.longitude,
                _POSITION_ACCURATE | (sender.speed_cm_s & 0x7FFF),
                sender.heading,
            ),
            bytes(_AROUND_POSITION[_SINGLE_HOP][1]),
            _BTP.pack(port, 0),
            payload,
        )
    )


def _payload_start(packet: bytes) -> int | None:
    """Return where the BTP header begins, None where the packet is of no kind that is read."""
    if len(packet) < HEADER_BYTES - _BTP.size or packet[0] != _VERSION_1 | _NEXT_COMMON:
        return None
    around = _AROUND_POSITION.get(_COMMON.unpack_from(packet, _BASIC.size)[1])
    return None if around is None else _START + around[0] + _POSITION.size + around[1]


def declared_bytes(packet: bytes) -> int:
    """Return the stated length of a packet, else its actual length."""
    start = _payload_start(packet)
    if start is None:
        return len(packet)
    return start + int(_COMMON.unpack_from(packet, _BASIC.size)[4])


def unwrap(datagram: bytes) -> Packet | Rejection:
    """Return the message in a broadcast, or why there is none."""
    envelope = b""
    if datagram[0] == _VERSION_1 | _NEXT_SECURED:
        envelope = datagram[_BASIC.size :]
        signed = signed_octets(envelope)
        if signed is None:
            return Rejection.SECURED
        datagram = bytes((_VERSION_1 | _NEXT_COMMON,)) + datagram[1 : _BASIC.size] + signed
    start = _payload_start(datagram)
    if start is None or len(datagram) <= start + _BTP.size:
        return Rejection.PACKET
    following, kind, _, _, length, _, _ = _COMMON.unpack_from(datagram, _BASIC.size)
    if following >> 4 != _NEXT_BTP_B or length != len(datagram) - start:
        return Rejection.PACKET
    port, _ = _BTP.unpack_from(datagram, start)
    position = _POSITION.unpack_from(datagram, _START + _AROUND_POSITION[kind][0])
    return Packet(datagram[start + _BTP.size :], port, position[2], envelope)


def transported(datagram: bytes) -> tuple[bytes, int] | None:
    """Return message and port of a datagram that begins with a BTP-B header; None where it is too short."""
    if len(datagram) <= _BTP.size:
        return None
    return datagram[_BTP.size :], int(_BTP.unpack_from(datagram)[0])

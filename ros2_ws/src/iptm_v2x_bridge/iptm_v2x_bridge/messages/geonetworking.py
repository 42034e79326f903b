"""Single-hop broadcast packets of GeoNetworking with BTP-B: the headers in front of a message on the air.

EN 302 636-4-1 (basic and common header, long position vector) and EN 302 636-5-1 (BTP-B).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from iptm_v2x_bridge.rejections import Rejection

CAM_PORT = 2001
TIMESTAMP_MODULUS_MS = 2**32

_BASIC = struct.Struct("!BBBB")
_COMMON = struct.Struct("!BBBBHBB")
_POSITION = struct.Struct("!H6sIiiHH")
_MEDIA = 4  # reserved bytes behind the position vector of a single-hop broadcast
_BTP = struct.Struct("!HH")
HEADER_BYTES = _BASIC.size + _COMMON.size + _POSITION.size + _MEDIA + _BTP.size

_VERSION_1, _NEXT_COMMON, _NEXT_SECURED = 0x10, 1, 2
_NEXT_BTP_B, _SINGLE_HOP = 2, 0x50
_LIFETIME_1_S = (1 << 2) | 1  # multiplier 1 of the base "1 s"
_STATION_MOVES, _POSITION_ACCURATE, _ADDRESS_BY_HAND = 0x80, 0x8000, 0x8000
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
    """A message and what its packet says about its time.

    Attributes:
        payload: the message.
        timestamp_ms: TimestampIts of the sender's position modulo 2^32; None for a bare message.
    """

    payload: bytes
    timestamp_ms: int | None = None


def wrap(payload: bytes, sender: SenderPosition, station_id: int, station_type: int) -> bytes:
    """Return a single-hop broadcast of a message.

    Args:
        payload: the message.
        sender: where and when.
        station_id: its lower bytes become the sender's link-layer address, locally administered.
        station_type: type of the station, 5 for a passenger car.
    """
    length = _BTP.size + len(payload)
    address = _ADDRESS_BY_HAND | (station_type & 0x1F) << 10
    link_layer = b"\x02\x00" + struct.pack("!I", station_id % 2**32)
    return b"".join(
        (
            _BASIC.pack(_VERSION_1 | _NEXT_COMMON, 0, _LIFETIME_1_S, 1),
            _COMMON.pack(_NEXT_BTP_B << 4, _SINGLE_HOP, _CLASS_2, _STATION_MOVES, length, 1, 0),
            _POSITION.pack(
                address,
                link_layer,
                sender.timestamp_ms % TIMESTAMP_MODULUS_MS,
                sender.latitude,
                sender.longitude,
                _POSITION_ACCURATE | (sender.speed_cm_s & 0x7FFF),
                sender.heading,
            ),
            bytes(_MEDIA),
            _BTP.pack(CAM_PORT, 0),
            payload,
        )
    )


def declared_bytes(packet: bytes) -> int:
    """Return how long a packet says that it is; as long as it is where it does not say."""
    start = HEADER_BYTES - _BTP.size
    if len(packet) < start or packet[0] != _VERSION_1 | _NEXT_COMMON:
        return len(packet)
    return start + int(_COMMON.unpack_from(packet, _BASIC.size)[4])


def unwrap(datagram: bytes) -> Packet | Rejection:
    """Return the message of a single-hop broadcast, or why there is none.

    Args:
        datagram: a packet from the basic header on.
    """
    if datagram[0] == _VERSION_1 | _NEXT_SECURED:
        return Rejection.SECURED
    if len(datagram) <= HEADER_BYTES or datagram[0] != _VERSION_1 | _NEXT_COMMON:
        return Rejection.PACKET
    following, kind, _, _, length, _, _ = _COMMON.unpack_from(datagram, _BASIC.size)
    start = HEADER_BYTES - _BTP.size
    if following >> 4 != _NEXT_BTP_B or kind != _SINGLE_HOP or length != len(datagram) - start:
        return Rejection.PACKET
    port, _ = _BTP.unpack_from(datagram, start)
    if port != CAM_PORT:
        return Rejection.PORT
    position = _POSITION.unpack_from(datagram, _BASIC.size + _COMMON.size)
    return Packet(datagram[HEADER_BYTES:], position[2])

"""From a datagram to one message, and back: what stands around a message on the air.

Messages begin with the header of TS 102 894-2 (ItsPduHeader). They may be bare, behind a BTP-B header alone
(EN 302 636-5-1, ports of TS 103 248; as routers pass it on over UDP), or in a broadcast of GeoNetworking (EN
302 636-4-1; single-hop and geographic) with BTP-B.

Cars on the road sign every message. The envelope of TS 103 097 is Ieee1609Dot2Data in canonical octet
encoding rules (IEEE 1609.2): version, the choice of signed data, hash algorithm, the payload with data and
no external hash, inside of it version, the choice of unsecured data, and the octets. Header information,
signer and signature follow. The envelope is removed here; its signature may be verified elsewhere, and octets
taken out without that are as trustworthy as those that are not signed.

Times are TimestampIts: milliseconds since 2004-01-01T00:00:00 TAI, of which cars send the low 16 bits.
"""

from __future__ import annotations

import struct
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from iptm_v2x_bridge.messages.octets import VERSION, Octets, UnreadableError
from iptm_v2x_bridge.rejections import Rejection

_SIGNED_DATA, _UNSECURED_DATA, _DATA_ONLY = 0x81, 0x80, 0x40
_HASH_ALGORITHMS = 2


def signed_octets(envelope: bytes) -> bytes | None:
    """Return the octets that an envelope signs, None for anything but an envelope around data.

    Args:
        envelope: from the version on, with anything behind the octets.
    """
    octets = Octets(envelope)
    try:
        found = take_data(octets)
        octets.number()  # a signer and a signature have to follow
    except UnreadableError:
        return None
    return found


def take_data(octets: Octets) -> bytes:
    """Return the octets that an envelope signs, which begin it behind its version and kind.

    Raises:
        UnreadableError: it is no envelope around data.
    """
    octets.expect(VERSION, _SIGNED_DATA)
    if octets.number() >= _HASH_ALGORITHMS:
        raise UnreadableError
    octets.expect(_DATA_ONLY, VERSION, _UNSECURED_DATA)
    return octets.string()


DELTA_MODULUS_MS = 65_536
ITS_EPOCH_UNIX_S = 1_072_915_200
"""2004-01-01T00:00:00 UTC in Unix time."""
LEAP_SECONDS_SINCE_2004 = 5
"""TAI gained on UTC since then: 2005, 2008, 2012, 2015, 2016; none later."""


def its_timestamp_ms(unix_time_ns: int) -> int:
    """Return the TimestampIts of an instant of Unix time (UTC)."""
    seconds = ITS_EPOCH_UNIX_S - LEAP_SECONDS_SINCE_2004
    return (unix_time_ns - seconds * 10**9) // 10**6


def delta_time_ms(timestamp_ms: int) -> int:
    """Return what a message carries of its time of generation."""
    return timestamp_ms % DELTA_MODULUS_MS


def resolve_delta_ms(delta_ms: int, now_ms: int, tolerance_ms: int) -> int:
    """Return the time of generation that a message means.

    Args:
        delta_ms: time of generation modulo 65,536 ms.
        now_ms: TimestampIts of the receiver's clock.
        tolerance_ms: how far ahead of it a sender's clock may be.

    Returns:
        The last instant with this remainder that is not later than now and the tolerance.
    """
    latest = now_ms + tolerance_ms
    return latest - (latest - delta_ms) % DELTA_MODULUS_MS


MAX_DATAGRAM_BYTES = 1400
"""Longest datagram looked at; a packet on the air has at most as much."""
PROTOCOL_VERSION = 2
MESSAGE_HEADER_BYTES = 6
ROADSIDE_UNIT = 15
"""Station type of roadside units."""
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
_CLASS_2 = 2  # traffic class of awareness messages


class MessageKind(Enum):
    """A kind of message: its number in the header, and the BTP port of its service."""

    CAM = (2, CAM_PORT)
    """Cooperative awareness (EN 302 637-2, TS 103 900)."""
    SPATEM = (4, 2004)
    """Signal phases and timing (TS 103 301)."""
    MAPEM = (5, 2003)
    """Lanes of intersections (TS 103 301)."""

    @property
    def message_id(self) -> int:
        """Number of the message in its header."""
        return int(self.value[0])

    @property
    def port(self) -> int:
        """BTP port of the service."""
        return int(self.value[1])


@dataclass(frozen=True)
class OpenedDatagram:
    """A message that begins as it should.

    Attributes:
        kind: which one.
        payload: the message, header included.
        packet_timestamp_ms: TimestampIts of the sender's position modulo 2^32, None without a packet.
        envelope: security envelope that it came in, empty without one; it has not been verified.
    """

    kind: MessageKind
    payload: bytes
    packet_timestamp_ms: int | None = None
    envelope: bytes = b""

    @property
    def secured(self) -> bool:
        """Whether it came in a security envelope."""
        return bool(self.envelope)


def open_datagram(datagram: bytes, wanted: Collection[MessageKind]) -> OpenedDatagram | Rejection:
    """Return the message in a datagram if it is of a wanted kind, or why not."""
    if not MESSAGE_HEADER_BYTES < len(datagram) <= MAX_DATAGRAM_BYTES:
        return Rejection.SIZE
    if datagram[0] == PROTOCOL_VERSION:
        kinds = [kind for kind in wanted if kind.message_id == datagram[1]]
        return OpenedDatagram(kinds[0], datagram) if kinds else Rejection.HEADER
    port, message = int(_BTP.unpack_from(datagram)[0]), datagram[_BTP.size :]
    for kind in wanted:
        if kind.port == port and message[:2] == bytes((PROTOCOL_VERSION, kind.message_id)):
            return OpenedDatagram(kind, message)
    return _unwrapped(datagram, wanted)


def _unwrapped(datagram: bytes, wanted: Collection[MessageKind]) -> OpenedDatagram | Rejection:
    """Return the message in a broadcast from the basic header on, or why there is none."""
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
    following, shape, _, _, length, _, _ = _COMMON.unpack_from(datagram, _BASIC.size)
    if following >> 4 != _NEXT_BTP_B or length != len(datagram) - start:
        return Rejection.PACKET
    port, _ = _BTP.unpack_from(datagram, start)
    position = _POSITION.unpack_from(datagram, _START + _AROUND_POSITION[shape][0])
    payload = datagram[start + _BTP.size :]
    for kind in wanted:
        if kind.port == port:
            if payload[:2] != bytes((PROTOCOL_VERSION, kind.message_id)):
                return Rejection.HEADER
            return OpenedDatagram(kind, payload, position[2], envelope)
    return Rejection.PORT


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


def wrap(
    payload: bytes,
    station_id: int,
    station_type: int,
    timestamp_ms: int,
    place_deg: tuple[float, float],
    speed_m_s: float = 0.0,
    heading_deg: float = 0.0,
    port: int = CAM_PORT,
) -> bytes:
    """Return a single-hop broadcast of a message to the BTP port of its service.

    The sender's link-layer address is locally administered: the lower bytes of the `station_id`.

    Args:
        timestamp_ms: TimestampIts of the sender's position, all of it or modulo 2^32.
        place_deg: latitude and longitude of the sender.
        heading_deg: clockwise from north.
    """
    length = _BTP.size + len(payload)
    address = _ADDRESS_BY_HAND | (station_type & 0x1F) << 10
    link_layer = b"\x02\x00" + struct.pack("!I", station_id % 2**32)
    flags = 0 if station_type == ROADSIDE_UNIT else _STATION_MOVES
    return b"".join(
        (
            _BASIC.pack(_VERSION_1 | _NEXT_COMMON, 0, _LIFETIME_1_S, 1),
            _COMMON.pack(_NEXT_BTP_B << 4, _SINGLE_HOP, _CLASS_2, flags, length, 1, 0),
            _POSITION.pack(
                address,
                link_layer,
                timestamp_ms % TIMESTAMP_MODULUS_MS,
                *(round(degrees * 1e7) for degrees in place_deg),
                _POSITION_ACCURATE | (round(speed_m_s * 100.0) & 0x7FFF),
                round(heading_deg * 10.0) % 3600,
            ),
            bytes(_AROUND_POSITION[_SINGLE_HOP][1]),
            _BTP.pack(port, 0),
            payload,
        )
    )

"""What every message begins with, and which service it belongs to: from a datagram to one message.

The header of TS 102 894-2 (ItsPduHeader) with the numbers of its messages, and the BTP ports of TS 103 248.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from iptm_v2x_bridge.messages.geonetworking import CAM_PORT, transported, unwrap
from iptm_v2x_bridge.rejections import Rejection

MAX_DATAGRAM_BYTES = 1400
"""Longest datagram looked at; a packet on the air has at most as much."""
PROTOCOL_VERSION = 2
HEADER_BYTES = 6
ROADSIDE_UNIT = 15
"""Station type of roadside units."""


class MessageKind(Enum):
    """A kind of message: its number in the header, and the port of its service."""

    CAM = (2, CAM_PORT)
    """Cooperative awareness (EN 302 637-2, TS 103 900)."""
    SPATEM = (4, 2004)
    """Signal phases and timing (TS 103 301)."""
    MAPEM = (5, 2003)
    """Lanes of intersections (TS 103 301)."""
    IVIM = (6, 2006)
    """In-vehicle information, here speed signs (TS 103 301)."""

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
    """Return the message in a datagram, or why there is none.

    It may be bare, behind a BTP-B header alone (as routers pass it on over UDP), or in a broadcast with
    BTP-B, secured or not.
    """
    if not HEADER_BYTES < len(datagram) <= MAX_DATAGRAM_BYTES:
        return Rejection.SIZE
    if datagram[0] == PROTOCOL_VERSION:
        kinds = [kind for kind in wanted if kind.message_id == datagram[1]]
        return OpenedDatagram(kinds[0], datagram) if kinds else Rejection.HEADER
    behind = _behind_its_port(datagram, wanted)
    if behind is not None:
        return behind
    packet = unwrap(datagram)
    if isinstance(packet, Rejection):
        return packet
    kinds = [kind for kind in wanted if kind.port == packet.port]
    if not kinds:
        return Rejection.PORT
    if packet.payload[:2] != bytes((PROTOCOL_VERSION, kinds[0].message_id)):
        return Rejection.HEADER
    return OpenedDatagram(kinds[0], packet.payload, packet.timestamp_ms, packet.envelope)


def _behind_its_port(datagram: bytes, wanted: Collection[MessageKind]) -> OpenedDatagram | None:
    """Return the message behind a BTP-B header with its port, None where the datagram is something else."""
    found = transported(datagram)
    if found is None:
        return None
    payload, port = found
    for kind in wanted:
        if kind.port == port and payload[:2] == bytes((PROTOCOL_VERSION, kind.message_id)):
            return OpenedDatagram(kind, payload)
    return None

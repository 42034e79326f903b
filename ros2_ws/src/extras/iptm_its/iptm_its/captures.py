"""Packets of vehicles in a capture of a network (pcap, pcapng).

What counts in a capture are GeoNetworking packets (EtherType 0x8947), on Ethernet, in frames of IEEE 802.11
(ITS-G5) or in Linux' cooked form, and the content of UDP datagrams to one port. Everything else is left out.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from iptm_core.errors import ParameterError
from iptm_core.user_input import read_bounded
from iptm_v2x_bridge.messages.packets import (
    ITS_EPOCH_UNIX_S,
    LEAP_SECONDS_SINCE_2004,
    declared_bytes,
)

GEONETWORKING_ETHERTYPE = 0x8947
MAX_BYTES = 1_000_000_000
_HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/capture.txt"
_NG_MAGIC = b"\x0a\x0d\x0d\x0a"
_PCAP_HEADER_BYTES = 24
_LEAST_RECORD_BYTES = 12
_LITTLE_ENDIAN_PCAP = (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1")
_LITTLE_ENDIAN_NG = 0x4D
_SNAP = b"\xaa\xaa\x03\x00\x00\x00"
_DATA_FRAME, _WITH_QOS = 2, 8
_LINKTYPE_RAW = 101


def read_capture(path: Path, port: int, warn: Callable[[str], None]) -> list[tuple[int, bytes]]:
    """Return what a capture holds for the receiver: times of reception (ns of TimestampIts) and packets.

    Raises:
        ParameterError: no such file, no capture, of an unknown link type or damaged, or nothing in it.
    """
    try:
        dpkt = import_module("dpkt")  # an extra
    except ImportError:
        raise ParameterError(
            f"recorded_packets is {str(path)!r}, but dpkt, which reads captures, is not installed; "
            f"allowed: a bag, or: {_HOW_TO}"
        ) from None
    try:
        content = read_bounded(path, MAX_BYTES)
    except OSError as reason:
        raise ParameterError(
            f"recorded_packets is {str(path)!r} ({reason}); allowed: a bag, .pcap or .pcapng"
        ) from reason
    try:
        kind = dpkt.pcapng if content.startswith(_NG_MAGIC) else dpkt.pcap
        whole = _whole_bytes(content)
        reader = kind.Reader(io.BytesIO(content[:whole]))
        frames = _Frames(dpkt, port)
        found = list(_packets(reader, frames.reader_of(reader.datalink())))
    except (dpkt.Error, ValueError, struct.error, LookupError, TypeError) as reason:
        raise ParameterError(
            f"recorded_packets is {str(path)!r}, which cannot be read as a capture ({reason}); "
            "allowed: pcap or pcapng of Ethernet, IP, IEEE 802.11 or Linux' cooked link"
        ) from reason
    if not found:
        raise ParameterError(
            f"recorded_packets is {str(path)!r}, which holds no GeoNetworking packet and no UDP datagram to "
            f"port {port}; allowed: a capture with one or more (parameter cam_port)"
        )
    if whole < len(content):
        warn(f"{path} was cut short within a packet; the {len(found)} before it are read")
    if frames.malformed:
        warn(f"{path}: {frames.malformed} malformed frames are left out")
    return found


def _whole_bytes(content: bytes) -> int:
    """Return where the last record that is complete ends."""
    at, order = 0, ">"
    is_ng = content.startswith(_NG_MAGIC)
    if not is_ng:
        at, order = _PCAP_HEADER_BYTES, "<" if content[:4] in _LITTLE_ENDIAN_PCAP else ">"
    while at + _LEAST_RECORD_BYTES <= len(content):
        if is_ng:
            if content.startswith(_NG_MAGIC, at):  # a section, which states its byte order
                order = "<" if content[at + 8] == _LITTLE_ENDIAN_NG else ">"
            size = int(struct.unpack_from(f"{order}I", content, at + 4)[0])
        else:
            size = 16 + int(struct.unpack_from(f"{order}I", content, at + 8)[0])
        if size < _LEAST_RECORD_BYTES or at + size > len(content):
            break
        at += size
    return at


def _packets(
    reader: Any, packet_in: Callable[[bytes], bytes | None]
) -> Iterator[tuple[int, bytes]]:
    begin_s = ITS_EPOCH_UNIX_S - LEAP_SECONDS_SINCE_2004
    for unix_s, frame in reader:
        packet = packet_in(bytes(frame))
        if packet is not None:
            # Whole microseconds: a binary fraction of so large a number holds no more.
            yield (round(float(unix_s) * 1e6) - begin_s * 10**6) * 1000, packet


class _Frames:
    """Takes the packets of vehicles out of frames.

    Attributes:
        malformed: frames that could not be read.
    """

    def __init__(self, dpkt: Any, port: int) -> None:
        self.malformed = 0
        self._dpkt, self._port = dpkt, port

    def reader_of(self, link_type: int) -> Callable[[bytes], bytes | None]:
        """Return what takes the packet out of a frame of a link type, None where there is none."""
        pcap = self._dpkt.pcap
        links: dict[int, Callable[[bytes], bytes | None]] = {
            pcap.DLT_EN10MB: self._ethernet,
            pcap.DLT_LINUX_SLL: self._cooked,
            pcap.DLT_RAW: self._internet,
            _LINKTYPE_RAW: self._internet,
            pcap.DLT_IEEE802_11: _of_wireless,
            pcap.DLT_IEEE802_11_RADIO: _of_monitor,
        }
        if link_type not in links:
            raise ValueError(f"link type {link_type}")

        def tolerant(frame: bytes) -> bytes | None:
            """Leave out what is cut or malformed, as a receiver would."""
            try:
                return links[link_type](frame)
            except (self._dpkt.Error, struct.error, IndexError):
                self.malformed += 1
                return None

        return tolerant

    def _ethernet(self, frame: bytes) -> bytes | None:
        read = self._dpkt.ethernet.Ethernet(frame)
        tags = getattr(read, "vlan_tags", None)
        return self._of_type(tags[-1].type if tags else read.type, read.data)

    def _cooked(self, frame: bytes) -> bytes | None:
        read = self._dpkt.sll.SLL(frame)
        return self._of_type(read.ethtype, read.data)

    def _internet(self, frame: bytes) -> bytes | None:
        six = frame[0] >> 4 == 6
        return self._of_ip(self._dpkt.ip6.IP6(frame) if six else self._dpkt.ip.IP(frame))

    def _of_type(self, ethertype: int, content: Any) -> bytes | None:
        if ethertype == GEONETWORKING_ETHERTYPE:
            return _without_padding(bytes(content))
        return self._of_ip(content)

    def _of_ip(self, packet: Any) -> bytes | None:
        datagram = getattr(packet, "data", None)
        if isinstance(datagram, self._dpkt.udp.UDP) and datagram.dport == self._port:
            return bytes(datagram.data)
        return None


def _of_monitor(frame: bytes) -> bytes | None:
    """Return the packet behind a radiotap header, whose length stands in its third and fourth bytes."""
    return _of_wireless(frame[struct.unpack_from("<H", frame, 2)[0] :])


def _of_wireless(frame: bytes) -> bytes | None:
    """Return the GeoNetworking packet in a data frame of IEEE 802.11 outside of any network."""
    kind, subtype = frame[0] >> 2 & 3, frame[0] >> 4
    if kind != _DATA_FRAME:
        return None
    body = frame[26 if subtype & _WITH_QOS else 24 :]
    if not body.startswith(_SNAP + struct.pack("!H", GEONETWORKING_ETHERTYPE)):
        return None
    return _without_padding(body[8:])


def _without_padding(packet: bytes) -> bytes:
    """Return a packet without what the link put behind it: padding, or the checksum of the frame."""
    return packet[: declared_bytes(packet)]

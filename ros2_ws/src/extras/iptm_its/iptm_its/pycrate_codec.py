"""Bits of the messages of roadside stations: the work of pycrate, an optional extra.

Its module ITS_IS holds SPATEM and MAPEM of TS 103 301 with what they are made of: SAE J2735 in the
profile of ISO/TS 19091. Nothing of pycrate is part of this project (LGPL-2.1).

Messages wait to be decoded, so that they cannot delay ticks and messages of cars: a map of 1.3 kB takes 5
ms, a message of a car 0.06 ms. Bytes stand for the time of decoding (3 to 4 us each, measured with pycrate),
so the same messages at the same times have the same outcome on every machine, live and recorded.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, cast

from iptm_core.errors import MessageError, ParameterError
from iptm_v2x_bridge.messages.packets import (
    MESSAGE_HEADER_BYTES,
    PROTOCOL_VERSION,
    MessageKind,
    OpenedDatagram,
)
from iptm_v2x_bridge.rejections import Rejection

HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/roadside.txt"
CONTENT = {MessageKind.SPATEM: "spat", MessageKind.MAPEM: "map"}
_LOCK = threading.Lock()
"""Every type holds the value that it works on."""


@cache
def specification() -> Any:
    """Return pycrate's module, once per process.

    Raises:
        ParameterError: it is not installed.
    """
    try:
        return import_module("pycrate_asn1dir.ITS_IS")
    except ImportError:
        raise ParameterError(
            "roadside_messages is True, but pycrate, which reads them, is not installed; allowed: False, "
            f"or: {HOW_TO}"
        ) from None


@cache
def _unreadable() -> tuple[type[Exception], ...]:
    return (import_module("pycrate_core.utils").PycrateErr,)


def _type(kind: MessageKind) -> Any:
    return getattr(getattr(specification(), f"{kind.name}_PDU_Descriptions"), kind.name)


def decode_fields(kind: MessageKind, payload: bytes) -> tuple[int, dict[str, Any]] | Rejection:
    """Return the station and the content of a message, or why it cannot be read."""
    message = _type(kind)
    with _LOCK:
        try:
            message.from_uper(payload)
        except _unreadable():
            return Rejection.DECODING
        value = message.get_val()
    return value["header"]["stationID"], value[CONTENT[kind]]


def encode_fields(kind: MessageKind, station_id: int, content: dict[str, Any]) -> bytes:
    """Return the bits of a message.

    Raises:
        MessageError: a field is missing or outside the range of the standard.
    """
    header = {
        "protocolVersion": PROTOCOL_VERSION,
        "messageID": kind.message_id,
        "stationID": station_id,
    }
    message = _type(kind)
    with _LOCK:
        try:
            message.set_val({"header": header, CONTENT[kind]: content})
            return cast("bytes", message.to_uper())
        except _unreadable() as reason:
            raise MessageError(f"{kind.name} cannot be encoded: {reason}") from reason


BYTES_PER_MS = 30
"""Decoded on average: a tenth of a processor core, or 15 intersections with phases ten times a second."""
BURST_BYTES = 5000
"""Decoded at once: about 20 ms, before which no tick is answered."""
KEPT_PER_STATION = 16
"""Newest messages kept of one kind and station; one station may send for several intersections."""
MAX_STATIONS = 128
"""Stations with waiting messages of one kind."""

_Waiting = dict[int, deque[tuple[OpenedDatagram, int]]]


class WaitingMessages:
    """Hands messages over within a budget: kinds in turn, stations in turn, each in order of arrival."""

    def __init__(self, decode: Callable[[OpenedDatagram, int], object]) -> None:
        """Set up; `decode` takes a message and the TimestampIts of its reception."""
        self._decode = decode
        self._waiting: dict[MessageKind, _Waiting] = {}
        self._budget_bytes = BURST_BYTES
        self._at_ms = 0

    def __len__(self) -> int:
        """Return the number of messages that wait."""
        return sum(len(kept) for kind in self._waiting.values() for kept in kind.values())

    def add(self, opened: OpenedDatagram, now_ms: int) -> bool:
        """Let a message wait; return whether one has been dropped for it, or it itself."""
        if now_ms > self._at_ms:
            self.decode(now_ms)  # before this message, whenever it was called last
        station_id = int.from_bytes(opened.payload[2:MESSAGE_HEADER_BYTES], "big")
        stations = self._waiting.setdefault(opened.kind, {})
        if station_id not in stations and len(stations) >= MAX_STATIONS:
            return True
        kept = stations.setdefault(station_id, deque(maxlen=KEPT_PER_STATION))
        is_full = len(kept) == KEPT_PER_STATION
        kept.append((opened, now_ms))
        return is_full

    def decode(self, now_ms: int) -> None:
        """Hand over what the budget allows by now (TimestampIts); the last message may exceed it."""
        passed_ms = max(now_ms - self._at_ms, 0)
        self._at_ms += passed_ms
        self._budget_bytes = min(self._budget_bytes + BYTES_PER_MS * passed_ms, BURST_BYTES)
        while self._waiting and self._budget_bytes > 0:
            opened, heard_ms = self._next()
            self._budget_bytes -= len(opened.payload)
            self._decode(opened, heard_ms)

    def _next(self) -> tuple[OpenedDatagram, int]:
        """Take out the message whose turn it is; its kind and its station go to the end of their rows."""
        kind = next(iter(self._waiting))
        stations = self._waiting.pop(kind)
        station_id = next(iter(stations))
        kept = stations.pop(station_id)
        found = kept.popleft()
        if kept:
            stations[station_id] = kept
        if stations:
            self._waiting[kind] = stations
        return found

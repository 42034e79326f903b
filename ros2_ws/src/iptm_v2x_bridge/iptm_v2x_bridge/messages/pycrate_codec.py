"""Bits of the messages of roadside stations: the work of pycrate, an optional extra.

Its module ITS_IS holds SPATEM, MAPEM and IVIM of TS 103 301 with what they are made of: SAE J2735 in the
profile of ISO/TS 19091, and ISO/TS 19321. Nothing of pycrate is part of this project (LGPL-2.1).
"""

from __future__ import annotations

import threading
from functools import cache
from importlib import import_module
from typing import Any, cast

from iptm_core.errors import MessageError, ParameterError
from iptm_v2x_bridge.messages.packets import PROTOCOL_VERSION, MessageKind
from iptm_v2x_bridge.rejections import Rejection

HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/roadside.txt"
CONTENT = {MessageKind.SPATEM: "spat", MessageKind.MAPEM: "map", MessageKind.IVIM: "ivi"}
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

"""Decodes CDR bytes with the definitions that a bag carries."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from iptm_core.errors import BagError
from iptm_recording.definitions import MessageDefinition, standard_typestore

_ENCAPSULATION_BYTES = 4
_ENCAPSULATIONS = (b"\x00\x00", b"\x00\x01")
_MISFIT = (SerdeError, struct.error, UnicodeDecodeError, ValueError, IndexError)


class Decoder:
    """Turns bytes into messages with named fields.

    A type whose hash equals that of the standard type uses the standard definition; every other
    one is built from the text in the bag, so that bags of other distributions and own types work.

    Args:
        definitions: definitions by type name.
    """

    def __init__(self, definitions: Mapping[str, MessageDefinition]) -> None:
        self._definitions = definitions
        self._stores: dict[str, Typestore] = {}

    def decode(self, data: bytes, type_name: str) -> Any:
        """Return the message.

        Raises:
            BagError: the bytes do not fit the type, or the type is not defined.
        """
        store = self._stores.get(type_name)
        if store is None:
            store = self._store_for(type_name)
            self._stores[type_name] = store
        if len(data) < _ENCAPSULATION_BYTES or data[:2] not in _ENCAPSULATIONS:
            raise BagError(f"{len(data)} bytes are no {type_name}: they are not plain CDR")
        msgdef = store.get_msgdef(type_name)
        read = msgdef.deserialize_cdr_le if data[1] else msgdef.deserialize_cdr_be
        # Not through the store's own function: it refuses the unused bytes that ROS's serialiser
        # leaves behind a message, when its estimate of the length was generous.
        try:
            message, _ = read(memoryview(data)[_ENCAPSULATION_BYTES:], 0, msgdef.cls, store)
        except _MISFIT as error:
            raise BagError(f"{len(data)} bytes are no {type_name}: {error}") from None
        return message

    def _store_for(self, type_name: str) -> Typestore:
        definition = self._definitions.get(type_name)
        standard = standard_typestore()
        if type_name in standard.fielddefs and (
            definition is None
            or not definition.text
            or definition.type_hash == standard.hash_rihs01(type_name)
        ):
            return standard
        if definition is None or not definition.text:
            raise BagError(f"type {type_name} is not standard and the bag does not define it")
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(get_types_from_msg(definition.text, type_name))
        except TypesysError as error:
            raise BagError(f"definition of {type_name} cannot be understood: {error}") from None
        return store

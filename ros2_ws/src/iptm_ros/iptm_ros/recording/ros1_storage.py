"""A bag of ROS 1 (`.bag`), read as if it had been recorded in ROS 2.

Types that exist in ROS 2 become those: most have the same content; where fields differ, those of the same
name are taken over. All other types keep their definition. ROS 1 has no checksums: a changed bit inside of a
message goes unnoticed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import final

from rosbags.convert.converter import STATIC_MSGTYPE_RENAMES, is_same_wireformat, migrate_bytes
from rosbags.interfaces import Connection, ConnectionExtRosbag1, Qos, QosDurability
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import decompressors
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from iptm_ros.recording.message_types import (
    MessageDefinition,
    message_definition,
    standard_typestore,
)
from iptm_ros.recording.recorded_topics import DEFAULT_QOS, TopicRecord
from iptm_ros.recording.storage import BagMessage, StorageFile
from iptm_ros.recording.unpacking import bz2_part, lz4_part

_HEADER = "std_msgs/msg/Header"
_LATCHED = DEFAULT_QOS._replace(depth=1, durability=QosDurability.TRANSIENT_LOCAL)

_BOUNDED = {decompressors["bz2"]: bz2_part, decompressors["lz4"]: lz4_part}


@final
class Ros1Storage(StorageFile):
    """See `StorageFile`; refuses what is not a ROS 1 bag. Its definitions are those of ROS 2."""

    kind, magic = "a ROS 1 bag", b"#ROSBAG V2.0\n"
    remedy = "save what is whole with the tools of ROS 1: rosbag reindex {path}"

    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
        connections = [
            connection
            for connection in self._reader.connections
            if topics is None or _name(connection) in topics
        ]
        if not connections:
            return
        for connection, time_ns, data in self._reader.messages(connections, start_ns, end_ns):
            type_name, convert = self._converters[connection.id]
            yield BagMessage(_name(connection), type_name, time_ns, time_ns, bytes(convert(data)))

    def _open(self, path: Path) -> None:
        self._reader = Reader(path)
        self._reader.open()
        self._opened.callback(self._reader.close)
        self._bound_chunks()
        definitions: dict[str, MessageDefinition] = {}
        self._converters: dict[int, tuple[str, Callable[[bytes], memoryview]]] = {}
        adapted: set[str] = set()
        promised: Counter[int] = Counter()
        for chunk in self._reader.chunk_infos:
            promised.update(chunk.connection_counts)
        topics = []
        for connection in self._reader.connections:
            definition, convert, is_adapted = _conversion(connection)
            definitions[definition.type_name] = definition
            self._converters[connection.id] = definition.type_name, convert
            if is_adapted:
                adapted.add(definition.type_name)
            topics.append(
                TopicRecord(
                    name=_name(connection),
                    type_name=definition.type_name,
                    type_hash=definition.type_hash,
                    offered_qos=_offered_qos(connection),
                    message_count=promised[connection.id],
                )
            )
        self.definitions, self.topics = definitions, topics
        self.message_count = promised.total()
        if self.message_count:
            self.start_ns = self._reader.start_time
            self.end_ns = self._reader.end_time - 1
        self.remarks = [
            f"{name} has other fields in ROS 1: what ROS 2 lacks is left out, what ROS 1 lacks is 0"
            for name in sorted(adapted)
        ]

    def _bound_chunks(self) -> None:
        """Let the chunks of the reader unpack to what fits into memory."""
        for place, chunk in self._reader.chunks.items():
            bound = _BOUNDED.get(chunk.decompressor)
            if bound is not None:
                self._reader.chunks[place] = chunk._replace(decompressor=bound)


def _name(connection: Connection) -> str:
    return f"/{connection.topic.lstrip('/')}"


def _offered_qos(connection: Connection) -> tuple[Qos, ...]:
    is_latched = isinstance(connection.ext, ConnectionExtRosbag1) and connection.ext.latching
    return (_LATCHED if is_latched else DEFAULT_QOS,)


def _conversion(
    connection: Connection,
) -> tuple[MessageDefinition, Callable[[bytes], memoryview], bool]:
    """Return the definition of a type in ROS 2, the function to CDR, and whether fields had to be adapted."""
    source = get_typestore(Stores.EMPTY)
    source.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    type_name = STATIC_MSGTYPE_RENAMES.get(connection.msgtype, connection.msgtype)
    target = standard_typestore()
    if type_name not in target.fielddefs:
        own = _own_typestore(source)
        text, _ = own.generate_msgdef(type_name, ros_version=2)
        definition = MessageDefinition(type_name, text, own.hash_rihs01(type_name))
        return definition, partial(own.ros1_to_cdr, typename=type_name), False
    definition = message_definition(type_name)
    if is_same_wireformat(source, target, connection.msgtype, type_name):
        return definition, partial(target.ros1_to_cdr, typename=type_name), False
    cache: dict[str, object] = {}
    adapt: Callable[[bytes], memoryview] = partial(
        _adapted, source, target, connection.msgtype, type_name, cache
    )
    return definition, adapt, True


def _own_typestore(source: Typestore) -> Typestore:
    """Return the types of a definition of ROS 1 with the header of ROS 2."""
    own = get_typestore(Stores.EMPTY)
    own.register({**source.fielddefs, _HEADER: standard_typestore().fielddefs[_HEADER]})
    return own


def _adapted(
    source: Typestore,
    target: Typestore,
    source_type: str,
    target_type: str,
    cache: dict[str, object],
    data: bytes,
) -> memoryview:
    return migrate_bytes(
        source, target, source_type, target_type, cache, data, src_is2=False, dst_is2=True
    )

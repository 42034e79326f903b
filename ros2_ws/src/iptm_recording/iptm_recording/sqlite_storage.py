"""An SQLite file of a rosbag2 bag (`.db3`), of every version of its schema.

It is read only, and as it lies there: no journal is played back, no lock taken. SQLite keeps no checksums, so
that a changed bit inside of a message goes unnoticed; the structure of the file is checked.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_recording.recorded_topics import TopicRecord, parse_profiles
from iptm_recording.storage import STORAGE_DAMAGE, RawMessage, StorageFile

_MAGIC = b"SQLite format 3\0"
_JOURNALS = ("-wal", "-journal")
_MOST_NS = 2**63 - 1


@final
class SqliteStorage(StorageFile):
    """See `StorageFile`.

    Raises:
        BagError: it cannot be read, is not a SQLite file of rosbag2, damaged, or was cut short.
    """

    def __init__(self, path: Path, source: Path | None = None) -> None:
        super().__init__(path, source)
        try:
            with path.open("rb") as file:
                start = file.read(len(_MAGIC))
        except OSError as error:
            raise BagError(f"cannot read {self.path}: {error}") from None
        if start != _MAGIC:
            raise BagError(f"{self.path} is not a SQLite file: it starts with {start!r}")
        for ending in _JOURNALS:
            journal = path.with_name(path.name + ending)
            if journal.exists() and journal.stat().st_size:
                raise BagError(
                    f"{self.path} has the journal {journal.name}: its recording was cut short;"
                    f" let SQLite complete it: sqlite3 {self.path} 'PRAGMA journal_mode=DELETE'"
                )
        # The player reads in its own thread, and only there.
        self._database = sqlite3.connect(
            f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1",
            uri=True,
            check_same_thread=False,
        )
        try:
            self._topics_by_id = self._read_topics()
            self.topics = list(self._topics_by_id.values())
            self._read_extent()
        except STORAGE_DAMAGE as error:
            self.close()
            raise self.damaged(error) from None
        except BagError:
            self.close()
            raise

    def definitions(self) -> dict[str, MessageDefinition]:
        """Return the message definitions by type name; files of before Iron hold none."""
        try:
            if not self._columns("message_definitions"):
                return {}
            rows = self._database.execute(
                "SELECT topic_type, encoding, encoded_message_definition, type_description_hash"
                " FROM message_definitions"
            ).fetchall()
        except STORAGE_DAMAGE as error:
            raise self.damaged(error) from None
        return {
            str(name): MessageDefinition(
                str(name), str(text) if encoding == SCHEMA_ENCODING else "", str(type_hash)
            )
            for name, encoding, text, type_hash in rows
        }

    def verify(self) -> None:
        """Check the structure of the file, and read everything once."""
        try:
            (verdict,) = self._database.execute("PRAGMA integrity_check(1)").fetchone()
        except STORAGE_DAMAGE as error:
            raise self.damaged(error) from None
        if verdict != "ok":
            raise self.damaged(str(verdict))
        super().verify()

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawMessage]:
        wanted = [
            key
            for key, topic in self._topics_by_id.items()
            if topics is None or topic.name in topics
        ]
        rows = self._database.execute(
            "SELECT topic_id, timestamp, data FROM messages"
            " WHERE topic_id IN (SELECT value FROM json_each(?)) AND timestamp BETWEEN ? AND ?"
            " ORDER BY timestamp, id",
            (
                json.dumps(wanted),
                -_MOST_NS if start_ns is None else start_ns,
                _MOST_NS if end_ns is None else end_ns - 1,
            ),
        )
        for key, time_ns, data in rows:
            if not isinstance(data, bytes):
                raise sqlite3.DataError(f"a message at {time_ns} ns is not a sequence of bytes")
            topic = self._topics_by_id[key]
            yield RawMessage(topic.name, topic.type_name, time_ns, time_ns, data)

    def _read_topics(self) -> dict[int, TopicRecord]:
        if not self._columns("topics") or not self._columns("messages"):
            raise BagError(f"{self.path} is not a rosbag2 bag: it lacks its tables")
        counts = dict(
            self._database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id")
        )
        topics: dict[int, TopicRecord] = {}
        cursor = self._database.execute("SELECT * FROM topics")
        names = [column[0] for column in cursor.description]
        for row in cursor:
            values = dict(zip(names, row, strict=True))
            if values["serialization_format"] != "cdr":
                raise BagError(
                    f"topic {values['name']} of {self.path} is encoded as"
                    f" {shown(values['serialization_format'])}; allowed: cdr"
                )
            key = values["id"]
            topics[key] = TopicRecord(
                name=str(values["name"]),
                type_name=str(values["type"]),
                # Distributions of before Foxy and of before Iron did not store these.
                type_hash=str(values.get("type_description_hash", "")),
                offered_qos=parse_profiles(str(values.get("offered_qos_profiles", ""))),
                message_count=counts.pop(key, 0),
            )
        if counts:
            raise sqlite3.DataError(f"{sum(counts.values())} messages belong to no topic")
        return topics

    def _read_extent(self) -> None:
        self.message_count, start_ns, end_ns = self._database.execute(
            "SELECT count(*), min(timestamp), max(timestamp) FROM messages"
        ).fetchone()
        self.start_ns, self.end_ns = int(start_ns or 0), int(end_ns or 0)

    def _columns(self, table: str) -> set[Any]:
        """Return the names of the columns of a table, empty if the table does not exist."""
        rows = self._database.execute("SELECT name FROM pragma_table_info(?)", (table,))
        return {row[0] for row in rows}

    def _way_out(self, path: Path) -> str:
        return f"save what is whole with: sqlite3 {path} .recover"

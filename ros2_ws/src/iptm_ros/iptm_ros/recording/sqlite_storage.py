"""An SQLite file of a rosbag2 bag (`.db3`), of every version of its schema.

It is read only, and as it lies there: no journal is played back, no lock taken. SQLite keeps no checksums, so
that a changed bit inside of a message goes unnoticed; the structure of the file is checked.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_ros.recording.recorded_topics import TopicRecord, parse_profiles
from iptm_ros.recording.storage import STORAGE_DAMAGE, BagMessage, StorageFile

_JOURNALS = ("-wal", "-journal")
_MOST_NS = 2**63 - 1


@final
class SqliteStorage(StorageFile):
    """See `StorageFile`; refuses what is not a SQLite file of rosbag2."""

    kind, magic = "a SQLite file", b"SQLite format 3\0"
    remedy = "save what is whole with: sqlite3 {path} .recover"

    def _open(self, path: Path) -> None:
        for ending in _JOURNALS:
            journal = path.with_name(path.name + ending)
            if journal.exists() and journal.stat().st_size:
                raise BagError(
                    f"{self.path} has the journal {journal.name}: its recording was cut short;"
                    f" let SQLite complete it: sqlite3 {self.path} 'PRAGMA journal_mode=DELETE'"
                )
        address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
        # The player reads in its own thread, and only there.
        database = sqlite3.connect(address, uri=True, check_same_thread=False)
        self._database = self._opened.enter_context(closing(database))
        self._topics_by_id = self._read_topics()
        self.topics = list(self._topics_by_id.values())
        self.message_count, start_ns, end_ns = self._database.execute(
            "SELECT count(*), min(timestamp), max(timestamp) FROM messages"
        ).fetchone()
        self.start_ns, self.end_ns = int(start_ns or 0), int(end_ns or 0)
        if self._columns("message_definitions"):  # files of before Iron hold none
            rows = self._database.execute(
                "SELECT topic_type, encoding, encoded_message_definition, type_description_hash"
                " FROM message_definitions"
            )
            self.definitions = {
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

    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
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
            yield BagMessage(topic.name, topic.type_name, time_ns, time_ns, data)

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

    def _columns(self, table: str) -> set[Any]:
        """Return the names of the columns of a table, empty if the table does not exist."""
        rows = self._database.execute("SELECT name FROM pragma_table_info(?)", (table,))
        return {row[0] for row in rows}

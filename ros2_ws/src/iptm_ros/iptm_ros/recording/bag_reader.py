"""Opens a bag, lists its topics and reads its messages, without ROS.

Accepts a rosbag2 folder with MCAP files, split or not, and a single file of one. Errors are one sentence with
a remedy; for other storages that is `rosbags-convert`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import replace
from functools import cached_property
from heapq import merge
from pathlib import Path
from typing import Any, final

from iptm_core.errors import BagError, MissingTopicError
from iptm_core.parameters import ModelParameters, load_parameters
from iptm_core.user_input import shown
from iptm_ros.recording.mcap_storage import CONVERT, BagFile
from iptm_ros.recording.message_types import Decoder, MessageDefinition
from iptm_ros.recording.recorded_topics import TopicRecord
from iptm_ros.recording.run_information import RECORD_NAME, RunInformation, stored_model_parameters
from iptm_ros.recording.storage import METADATA_FILE, BagMessage, read_metadata

_OTHERS = ("*.db3", "*.bag", "*.zstd")


@final
class BagReader(AbstractContextManager["BagReader"]):
    """A bag opened for reading; use it as a context manager or call `close`.

    Attributes:
        path: of the bag.
        topics: recorded topics by name.

    Raises:
        BagError: missing, not a bag, of another storage, or cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        check_exists(path)
        self._metadata = read_metadata(path) if (path / METADATA_FILE).is_file() else {}
        self._files = _open_files(path, self._metadata)
        try:
            self.topics: Mapping[str, TopicRecord] = _merge_topics(path, self._files)
            self._compare_with_metadata()
            self._definitions: dict[str, MessageDefinition] = {}
            for file in self._files:
                self._definitions.update(file.definitions)
        except BagError:
            self.close()
            raise
        self._decoder = Decoder(self._definitions)

    @property
    def message_count(self) -> int:
        """Messages of all topics together."""
        return sum(topic.message_count for topic in self.topics.values())

    @property
    def start_ns(self) -> int:
        """Earliest log time, 0 for an empty bag."""
        return min((file.start_ns for file in self._files if file.message_count), default=0)

    @property
    def end_ns(self) -> int:
        """Latest log time, 0 for an empty bag."""
        return max((file.end_ns for file in self._files), default=0)

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message."""
        return (self.end_ns - self.start_ns) * 1e-9

    @cached_property  # all of the file is checked for them
    def custom_data(self) -> dict[str, str]:
        """Texts about the run, from the files themselves (later ones count) or else from `metadata.yaml`."""
        found = [file.metadata_record(RECORD_NAME) for file in self._files]
        if any(texts is not None for texts in found):
            return {key: value for texts in found for key, value in (texts or {}).items()}
        custom = self._metadata.get("custom_data") or {}
        return {str(key): str(value) for key, value in custom.items()}

    def run_information(self) -> RunInformation:
        """Return what the run depended on (defaults where another recorder stored nothing)."""
        return RunInformation.from_custom_data(self.custom_data)

    def definition_text(self, type_name: str) -> str:
        """Return the definition of a message type as the bag stores it, "" if it does not."""
        definition = self._definitions.get(type_name)
        return definition.text if definition else ""

    def resolve(self, name: str, type_name: str | None = None) -> TopicRecord:
        """Find a topic.

        Args:
            name: full name, or a relative one such as `plant/odometry` in whatever namespace.
            type_name: type it must have; any by default.

        Raises:
            MissingTopicError: no such topic.
            BagError: several in different namespaces, or another type.
        """
        if name in self.topics:
            found = [name]
        else:
            suffix = f"/{name.lstrip('/')}"
            found = [] if name.startswith("/") else [t for t in self.topics if t.endswith(suffix)]
        if not found:
            known = ", ".join(sorted(self.topics)) or "none"
            raise MissingTopicError(f"{self.path} has no topic {name!r}; its topics are: {known}")
        if len(found) > 1:
            raise BagError(
                f"{self.path} has several topics {name!r}: {', '.join(sorted(found))};"
                " name one in full"
            )
        topic = self.topics[found[0]]
        if type_name is not None and topic.type_name != type_name:
            raise BagError(
                f"type of topic {topic.name} of {self.path} is {topic.type_name};"
                f" allowed: {type_name}"
            )
        return topic

    def raw_messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages in order of their log times; equal times stay in the order of reception.

        Args:
            topics: full names; all by default.
            start_ns: first log time wanted.
            end_ns: log time before which to stop.

        Raises:
            BagError: a name is unknown, or the file is damaged (while iterating).
        """
        for name in topics or ():
            if name not in self.topics:
                self.resolve(name)
                raise BagError(f"topic is {name!r}; allowed: a full name, with '/' in front")
        for together in _overlapping(self._files):
            yield from merge(
                *(file.messages(topics, start_ns, end_ns) for file in together),
                key=lambda message: message.log_time_ns,
            )

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield decoded messages; see `raw_messages`.

        Raises:
            BagError: as there, or a message does not fit its type.
        """
        for raw in self.raw_messages(topics, start_ns, end_ns):
            yield replace(raw, message=self.decode(raw))

    def decode(self, raw: BagMessage) -> Any:
        """Decode one message with the definition stored in the bag."""
        try:
            return self._decoder.decode(raw.data, raw.type_name)
        except BagError as error:
            raise BagError(
                f"{self.path}: message of {raw.topic} at {raw.log_time_ns} ns: {error}"
            ) from None

    def verify(self) -> None:
        """Read everything once.

        Raises:
            BagError: a file is damaged, or holds fewer messages than stated.
        """
        for file in self._files:
            file.verify()

    def close(self) -> None:
        """Close the files; a second call is free."""
        for file in self._files:
            file.close()

    def _compare_with_metadata(self) -> None:
        stated = self._metadata.get("message_count", self.message_count)
        if stated != self.message_count:
            raise BagError(
                f"{self.path / METADATA_FILE} states {shown(stated)} messages, its files hold"
                f" {self.message_count}; save the intact part with: scripts/iptm recover {self.path}"
            )

    def __exit__(self, *error: object) -> None:
        """Close the files."""
        self.close()


def opened(bag: Path | BagReader) -> AbstractContextManager[BagReader]:
    """Return a reader of a bag, which ends with the context where it was not open before."""
    return nullcontext(bag) if isinstance(bag, BagReader) else BagReader(bag)


def read_model_parameters(bag: Path | BagReader) -> tuple[ModelParameters, bool]:
    """Return the parameters to judge a recorded run by.

    Returns:
        The parameters of the run and True; or the default set and False where the bag has none.

    Raises:
        BagError: the bag cannot be read, or its parameters are malformed.
    """
    with opened(bag) as reader:
        stored = stored_model_parameters(reader.run_information())
    return (load_parameters().values, False) if stored is None else (stored, True)


def _overlapping(files: Sequence[BagFile]) -> Iterator[list[BagFile]]:
    """Yield the files in recording order, those together whose log times overlap (a clock went back)."""
    together: list[BagFile] = []
    latest_ns = 0
    for position, file in enumerate(files):
        later = (other.start_ns for other in files[position:] if other.message_count)
        if together and min(later, default=latest_ns) >= latest_ns:
            yield together
            together = []
        together.append(file)
        latest_ns = max(latest_ns, file.end_ns)
    yield together


def _merge_topics(path: Path, files: Collection[BagFile]) -> dict[str, TopicRecord]:
    topics: dict[str, TopicRecord] = {}
    for topic in (topic for file in files for topic in file.topics):
        before = topics.get(topic.name)
        if before is not None and before.type_name != topic.type_name:
            raise BagError(
                f"topic {topic.name} of {path} has two types,"
                f" {before.type_name} and {topic.type_name}: not supported"
            )
        count = topic.message_count + (before.message_count if before else 0)
        topics[topic.name] = replace(topic, message_count=count)
    return topics


def _open_files(path: Path, metadata: Mapping[str, Any]) -> list[BagFile]:
    """Open the files of a bag, in recording order.

    Raises:
        BagError: the bag does not exist, is of another kind, or a file is damaged.
    """
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(BagFile(file))) for file in _files(path, metadata)]
        stack.pop_all()
    return opened


def check_exists(path: Path) -> None:
    """Refuse a bag that is not there."""
    try:
        exists = path.exists()
    except OSError as error:
        raise BagError(f"bag {shown(str(path))}: {error.strerror}") from None
    if not exists:
        raise BagError(f"{path} does not exist")


def _files(path: Path, metadata: Mapping[str, Any]) -> list[Path]:
    if path.is_file():
        return [path]
    if metadata:
        return _listed_files(path, metadata)
    if any(path.glob("*.mcap")):
        raise BagError(
            f"{path} has no metadata.yaml: its recording was cut short;"
            f" repair it with: scripts/iptm recover {path}"
        )
    others = sorted(file for ending in _OTHERS for file in path.glob(ending))
    if others:
        raise BagError(CONVERT.format(path=path, source=others[0]))
    raise BagError(f"{path} is not a bag: it holds neither metadata.yaml nor an .mcap file")


def _listed_files(folder: Path, metadata: Mapping[str, Any]) -> list[Path]:
    is_packed = str(metadata.get("compression_mode") or "none").lower() != "none"
    if metadata.get("storage_identifier") != "mcap" or is_packed:
        raise BagError(CONVERT.format(path=folder, source=folder))
    names = metadata.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise BagError(f"{folder / 'metadata.yaml'} names no file in relative_file_paths")
    files = [folder / Path(str(name)).name for name in names]
    if len(set(files)) < len(files):
        raise BagError(f"{folder / 'metadata.yaml'} names a file twice in relative_file_paths")
    for file in files:
        if not file.is_file():
            raise BagError(f"{file} is missing, though metadata.yaml of its bag names it")
    return files

"""Bags of other storages are refused in one line, which names the command that converts them."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader

NONE, FILE, MESSAGE = CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE
STORAGES = [
    (StoragePlugin.SQLITE3, NONE),
    (StoragePlugin.SQLITE3, FILE),
    (StoragePlugin.SQLITE3, MESSAGE),
    (StoragePlugin.MCAP, FILE),
    (StoragePlugin.MCAP, MESSAGE),
]


@pytest.fixture(params=STORAGES, ids=lambda p: f"{p[0].name}-{p[1].name}".lower())
def other_bag(small_bag: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Hold what `small_bag` holds, as rosbag2 would have stored it."""
    storage, mode = request.param
    writer = Writer(tmp_path / "other", version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with BagReader(small_bag) as reader, writer:
        connections = {
            topic.name: writer.add_connection(
                topic.name, topic.type_name, typestore=get_typestore(Stores.ROS2_JAZZY)
            )
            for topic in reader.topics.values()
        }
        for message in reader.raw_messages():
            writer.write(connections[message.topic], message.log_time_ns, message.data)
    return tmp_path / "other"


def content(bag: Path) -> list[tuple[str, int, bytes]]:
    with BagReader(bag) as reader:
        return [(m.topic, m.log_time_ns, m.data) for m in reader.raw_messages()]


def test_the_command_of_the_refusal_makes_a_bag_that_is_read(
    small_bag: Path, other_bag: Path, tmp_path: Path
) -> None:
    with pytest.raises(BagError, match="is no plain MCAP bag") as caught:
        BagReader(other_bag)
    text = str(caught.value)
    assert "\n" not in text
    program, *arguments = shlex.split(text.partition("convert it with: ")[2])
    arguments[arguments.index("DIR")] = str(tmp_path / "new")
    command = [str(Path(sys.executable).with_name(program)), *arguments]
    subprocess.run(command, check=True, capture_output=True)
    assert content(tmp_path / "new") == content(small_bag)


def test_single_files_of_other_storages_are_refused_alike(other_bag: Path) -> None:
    (file,) = (path for path in other_bag.iterdir() if path.name != "metadata.yaml")
    with pytest.raises(BagError, match="convert it with: rosbags-convert --src"):
        content(file)
    (other_bag / "metadata.yaml").unlink()
    if not file.match("*.mcap"):
        with pytest.raises(BagError, match=f"rosbags-convert --src {file}"):
            BagReader(other_bag)


def test_a_bag_of_ros_1_is_refused_alike(tmp_path: Path) -> None:
    file = tmp_path / "old.bag"
    file.write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    with pytest.raises(BagError, match=r"convert it with: rosbags-convert --src .*old\.bag"):
        BagReader(file)

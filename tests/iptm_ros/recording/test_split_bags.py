"""A bag of several files is one bag."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from iptm_core.errors import BagError
from iptm_ros.recording import mcap_file
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.mcap_file import MOST_INDEX_BYTES, FileLimits

FLOAT = "std_msgs/msg/Float64"
SECOND_NS = 10**9
Encode = Callable[[float], bytes]


def write_bag(folder: Path, encode: Encode, limits: FileLimits, times_s: range = range(60)) -> Path:
    with BagWriter(folder, custom_data={"scenario": "wltc", "seed": "7"}, limits=limits) as writer:
        ids = [writer.add_topic(name, FLOAT) for name in ("/a", "/b")]
        for k, time_s in enumerate(times_s):
            for topic_id in ids:
                writer.write(topic_id, encode(k), time_s * SECOND_NS)
            writer.flush()
            if k == 30:
                ids.append(writer.add_topic("/late", FLOAT))
                writer.add_information({"late": "found out while driving"})
    return folder


@pytest.fixture
def split_bag(tmp_path: Path, encode: Encode) -> Path:
    """A bag of three topics and 60 ticks in 6 files; the last topic comes in the middle."""
    return write_bag(tmp_path / "split", encode, FileLimits(max_bag_duration=10))


def feed(writer: BagWriter, ticks: int, topic_count: int = 14) -> int:
    """Write as the recorder does, a chunk every tick, and return by how much memory grew at most."""
    ids = [writer.add_topic(f"/t{k}", FLOAT) for k in range(topic_count)]
    data = bytes([0, 1, 0, 0]) + bytes(8)
    tracemalloc.start()
    try:
        for tick in range(ticks):
            for topic_id in ids:
                writer.write(topic_id, data, tick * SECOND_NS)
            writer.flush()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("topic_count", [1, 14])
def test_memory_of_a_long_recording_is_bounded(
    topic_count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_file, "MOST_INDEX_BYTES", 200_000)
    with BagWriter(tmp_path / "bag") as writer:
        grown = feed(writer, 800, topic_count)
    # The summary of a file is put together in memory when it is completed, hence the factor.
    assert grown < 400_000
    with BagReader(tmp_path / "bag") as reader:
        assert reader.message_count == 800 * topic_count


def test_a_trip_of_half_an_hour_is_one_file_and_a_long_one_stays_below_5_mb() -> None:
    assert MOST_INDEX_BYTES < 4e6
    index_bytes = mcap_file._INDEX_BYTES_PER_CHUNK + 14 * mcap_file._INDEX_BYTES_PER_TOPIC
    assert 1800 * index_bytes < MOST_INDEX_BYTES


def test_every_reader_takes_the_files_as_one_bag(
    split_bag: Path, tmp_path: Path, encode: Encode
) -> None:
    assert len(list(split_bag.glob("*.mcap"))) == 6
    whole = write_bag(tmp_path / "whole", encode, FileLimits())
    with BagReader(split_bag) as reader, BagReader(whole) as other:
        assert reader.topics == other.topics
        assert list(reader.raw_messages()) == list(other.raw_messages())
        assert (reader.start_ns, reader.end_ns) == (other.start_ns, other.end_ns)
        assert reader.custom_data == other.custom_data
        assert reader.custom_data["late"] == "found out while driving"
        part = list(reader.raw_messages(["/a"], 15 * SECOND_NS, 42 * SECOND_NS))
        assert [message.log_time_ns for message in part] == [k * SECOND_NS for k in range(15, 42)]
    with Reader(split_bag) as foreign:
        assert sum(1 for _ in foreign.messages()) == foreign.message_count == 149


def test_each_file_stands_on_its_own(split_bag: Path) -> None:
    for number in range(6):
        file = split_bag / f"split_{number}.mcap"
        with file.open("rb") as stream:
            summary = make_reader(stream, validate_crcs=True).get_summary()
        assert summary is not None
        assert all(index.message_index_offsets for index in summary.chunk_indexes)
        with BagReader(file) as reader:
            assert len(list(reader.messages(["/a"]))) == 10
            assert reader.run_information().scenario == "wltc"


def test_metadata_lists_the_files_as_rosbag2_does(split_bag: Path) -> None:
    content = yaml.safe_load((split_bag / "metadata.yaml").read_text())
    bag = content["rosbag2_bagfile_information"]
    names = [f"split_{k}.mcap" for k in range(6)]
    assert bag["relative_file_paths"] == [file["path"] for file in bag["files"]] == names
    assert [f["message_count"] for f in bag["files"]] == [20, 20, 20, 29, 30, 30]
    starts = [f["starting_time"]["nanoseconds_since_epoch"] for f in bag["files"]]
    assert starts == [10 * k * SECOND_NS for k in range(6)]
    assert {f["duration"]["nanoseconds"] for f in bag["files"]} == {9 * SECOND_NS}
    assert bag["duration"]["nanoseconds"] == 59 * SECOND_NS


def test_split_by_size(tmp_path: Path, encode: Encode) -> None:
    limit = 65_536
    folder = write_bag(tmp_path / "bag", encode, FileLimits(max_bag_size=limit), range(1000))
    sizes = [path.stat().st_size for path in folder.glob("*.mcap")]
    assert len(sizes) > 3
    assert max(sizes) < 3 * limit  # index and metadata come on top


def test_a_clock_that_goes_back_keeps_the_order_of_time(tmp_path: Path, encode: Encode) -> None:
    with BagWriter(tmp_path / "bag", limits=FileLimits(max_bag_duration=10)) as writer:
        topic_id = writer.add_topic("/a", FLOAT)
        for time_s in (*range(25), *range(5, 40)):
            writer.write(topic_id, encode(time_s), time_s * SECOND_NS)
    with BagReader(tmp_path / "bag") as reader:
        times = [message.log_time_ns for message in reader.raw_messages()]
    assert times == sorted(SECOND_NS * k for k in (*range(25), *range(5, 40)))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"max_bag_size": 5}, r"max_bag_size is 5; allowed: 0 .*65536"),
        ({"max_bag_size": -1}, r"max_bag_size is -1"),
        ({"max_bag_duration": -3}, r"max_bag_duration is -3; allowed: 0"),
    ],
)
def test_limits_nobody_can_want(limits: dict[str, int], message: str) -> None:
    with pytest.raises(BagError, match=message):
        FileLimits(**limits)

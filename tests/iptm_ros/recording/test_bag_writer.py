"""What is written is read by other programs, and a full disk is reported."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from tests.iptm_ros.recording.conftest import messages_of_unfinished

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import message_definition
from iptm_ros.recording.run_information import RunInformation
from iptm_ros.recording.storage import NO_START_NS

FLOAT = "std_msgs/msg/Float64"
Encode = Callable[[float], bytes]


def test_rosbags_reads_what_was_written(small_bag: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(small_bag) as reader:
        assert [(c.topic, c.msgtype, c.msgcount) for c in reader.connections] == [
            ("/a", FLOAT, 20),
            ("/b", FLOAT, 20),
        ]
        assert reader.connections[0].digest == store.hash_rihs01(FLOAT)
        content = [
            (connection.topic, time_ns, getattr(store.deserialize_cdr(data, FLOAT), "data", None))
            for connection, time_ns, data in reader.messages()
        ]
    assert content[:3] == [("/a", 0, 0.0), ("/b", 1, 0.0), ("/a", 10**9, 1.0)]
    assert len(content) == 40


def test_mcap_library_reads_what_was_written(small_bag: Path) -> None:
    with (small_bag / "small_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 40
        assert summary.statistics.message_end_time == 19 * 10**9 + 1
        assert (len(summary.schemas), len(summary.channels)) == (1, 2)
        schema = summary.schemas[1]
        assert (schema.name, schema.encoding) == (FLOAT, "ros2msg")
        assert schema.data.decode() == message_definition(FLOAT).text
        channel = next(c for c in summary.channels.values() if c.topic == "/a")
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["depth"] == 10
        assert [record.name for record in reader.iter_metadata()] == ["iptm_run", "rosbag2"]
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert times == sorted(times)


def test_metadata_is_version_9(small_bag: Path) -> None:
    content = yaml.safe_load((small_bag / "metadata.yaml").read_text())
    information = content["rosbag2_bagfile_information"]
    topics = information.pop("topics_with_message_count")
    assert information.pop("ros_distro")
    assert information == {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 19 * 10**9 + 1},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 40,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["small_0.mcap"],
        "files": [
            {
                "path": "small_0.mcap",
                "starting_time": {"nanoseconds_since_epoch": 0},
                "duration": {"nanoseconds": 19 * 10**9 + 1},
                "message_count": 40,
            }
        ],
        "custom_data": {"scenario": "small", "seed": "7"},
    }
    assert topics[0]["message_count"] == 20
    topic = topics[0]["topic_metadata"]
    assert topic["name"] == "/a"
    assert topic["serialization_format"] == "cdr"
    (qos,) = topic["offered_qos_profiles"]
    assert (qos["history"], qos["depth"], qos["reliability"]) == ("keep_last", 10, "reliable")
    assert qos["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert topic["type_description_hash"] == message_definition(FLOAT).type_hash


def test_metadata_travels_inside_the_file_as_well(small_bag: Path) -> None:
    outside = yaml.safe_load((small_bag / "metadata.yaml").read_text())
    with (small_bag / "small_0.mcap").open("rb") as file:
        record = next(r for r in make_reader(file).iter_metadata() if r.name == "rosbag2")
    inside = yaml.safe_load(record.metadata["serialized_metadata"])
    assert inside == outside["rosbag2_bagfile_information"]


def test_run_information_survives(tmp_path: Path) -> None:
    information = RunInformation(
        scenario="wltc",
        seed=0,
        parameters="a: 1\n# with a comment: and a colon\nb: [1, 2]\n",
        git_revision="abc-dirty",
        versions={"python": "3.10", "casadi": "3.6"},
        started_at_utc="2026-01-01T00:00:00+00:00",
        extra={"strategy": "J1 J4"},
    )
    with BagWriter(tmp_path / "bag", custom_data=information.to_custom_data()):
        pass
    with BagReader(tmp_path / "bag") as reader:
        assert reader.run_information() == information
    with BagReader(tmp_path / "bag" / "bag_0.mcap") as reader:
        assert reader.run_information() == information


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_many_chunks_and_a_message_larger_than_a_chunk(
    tmp_path: Path, encode: Encode, compression: str
) -> None:
    folder = tmp_path / "bag"
    big = bytes([0, 1, 0, 0]) + (100_000).to_bytes(4, "little") + b"x" * 99_999 + b"\0"
    with BagWriter(folder, compression=compression, chunk_bytes=1000) as writer:
        floats = writer.add_topic("/floats", FLOAT)
        texts = writer.add_topic("/texts", "std_msgs/msg/String")
        for k in range(500):
            writer.write(floats, encode(k), k)
            if k % 100 == 50:
                writer.write(texts, big, k)
    with BagReader(folder) as reader:
        values = [m.message.data for m in reader.messages(["/floats"])]
        assert values == [float(k) for k in range(500)]
        assert {len(m.message.data) for m in reader.messages(["/texts"])} == {99_999}
    with Reader(folder) as other:
        assert sum(1 for _ in other.messages()) == 505


def test_messages_come_back_in_time_order_whatever_the_order_of_writing(
    tmp_path: Path, encode: Encode
) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder, chunk_bytes=300) as writer:
        topic = writer.add_topic("/a", FLOAT)
        for k in reversed(range(100)):
            writer.write(topic, encode(k), k, publish_time_ns=1000 + k)
    with BagReader(folder) as reader:
        messages = list(reader.raw_messages())
        assert (reader.start_ns, reader.end_ns) == (0, 99)
    assert [m.log_time_ns for m in messages] == list(range(100))
    assert [m.publish_time_ns for m in messages] == list(range(1000, 1100))


def test_equal_times_stay_in_the_order_of_writing(tmp_path: Path, encode: Encode) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder, chunk_bytes=200) as writer:
        ids = [writer.add_topic(f"/t{k}", FLOAT) for k in range(3)]
        for k in range(60):
            writer.write(ids[k % 3], encode(k), 5)
    with BagReader(folder) as reader:
        assert [m.message.data for m in reader.messages()] == [float(k) for k in range(60)]


def test_empty_bag_is_sound(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic("/a", FLOAT)
    with BagReader(tmp_path / "empty") as reader:
        assert reader.message_count == 0
        assert reader.duration_s == 0.0
        assert list(reader.raw_messages()) == []
    with Reader(tmp_path / "empty") as other:
        assert other.message_count == 0
    content = yaml.safe_load((tmp_path / "empty" / "metadata.yaml").read_text())
    start = content["rosbag2_bagfile_information"]["starting_time"]
    assert start["nanoseconds_since_epoch"] == NO_START_NS


def test_existing_folder_is_never_overwritten(small_bag: Path) -> None:
    before = (small_bag / "small_0.mcap").read_bytes()
    with pytest.raises(BagError, match="exists already"):
        BagWriter(small_bag)
    assert (small_bag / "small_0.mcap").read_bytes() == before


def test_parent_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot create"):
        BagWriter(tmp_path / "file" / "bag")


def test_relative_topic_and_repeated_topic_are_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/a", FLOAT)
        with pytest.raises(BagError, match="fully qualified"):
            writer.add_topic("a", FLOAT)
        with pytest.raises(BagError, match="already"):
            writer.add_topic("/a", FLOAT)
        with pytest.raises(BagError, match="unknown"):
            writer.add_topic("/c", "no_msgs/msg/Such")


def test_unknown_compression(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"'gzip'; allowed:.*lz4"):
        BagWriter(tmp_path / "bag", compression="gzip")
    assert not (tmp_path / "bag").exists()


def test_an_error_inside_the_block_leaves_a_sound_bag(tmp_path: Path, encode: Encode) -> None:
    def fail() -> None:
        with BagWriter(tmp_path / "bag") as writer:
            writer.write(writer.add_topic("/a", FLOAT), encode(1.0), 1)
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    with BagReader(tmp_path / "bag") as reader:
        assert reader.message_count == 1


FILL_DISK = """
import signal, sys
from pathlib import Path
from iptm_core.errors import BagError
from iptm_ros.recording.bag_writer import BagWriter

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
writer = BagWriter(Path(sys.argv[1]), chunk_bytes=4096)
topic = writer.add_topic("/a", "std_msgs/msg/Float64")
written = 0
try:
    while True:
        for _ in range(10):
            writer.write(topic, bytes([0, 1, 0, 0]) + bytes(8), written)
        writer.flush()
        written += 10
except BagError as error:
    print(written, error)
try:
    writer.close()
except BagError as error:
    print(error)
"""


def test_full_disk_is_reported_and_loses_nothing_flushed(tmp_path: Path) -> None:
    limit = 50_000
    done = subprocess.run(
        [sys.executable, "-c", FILL_DISK, str(tmp_path / "bag")],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    count, _, message = done.stdout.partition(" ")
    assert message.count("cannot write") == 2
    assert done.stderr == ""
    kept = messages_of_unfinished(tmp_path / "bag" / "bag_0.mcap")
    assert 500 < int(count) <= kept < int(count) + 10

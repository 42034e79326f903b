"""Messages of a bag come in the order of time, by topic and interval."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import MessageDefinition

FLOAT = "std_msgs/msg/Float64"
Encode = Callable[[float], bytes]


def edit_metadata(bag: Path, **changes: Any) -> None:
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"].update(changes)
    path.write_text(yaml.safe_dump(content))


def test_folder_and_file_hold_the_same(small_bag: Path) -> None:
    with BagReader(small_bag) as folder, BagReader(small_bag / "small_0.mcap") as file:
        assert list(folder.messages()) == list(file.messages())
        assert folder.topics == file.topics
        assert folder.custom_data == file.custom_data == {"scenario": "small", "seed": "7"}
        assert folder.duration_s == pytest.approx(19.0)


def test_part_of_a_bag(small_bag: Path) -> None:
    with BagReader(small_bag) as reader:
        part = [m.message.data for m in reader.messages(["/a"], 5 * 10**9, 8 * 10**9)]
    assert part == [5.0, 6.0, 7.0]


def test_two_iterations_do_not_disturb_each_other(small_bag: Path) -> None:
    with BagReader(small_bag) as reader:
        pairs = list(zip(reader.raw_messages(["/a"]), reader.raw_messages(["/b"]), strict=True))
    assert [first.log_time_ns + 1 == second.log_time_ns for first, second in pairs] == [True] * 20


def test_missing_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="does not exist"):
        BagReader(tmp_path / "nothing")


def test_folder_that_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="not a bag"):
        BagReader(tmp_path)


def test_killed_recording_names_the_way_out(small_bag: Path) -> None:
    (small_bag / "metadata.yaml").unlink()
    with pytest.raises(BagError, match=r"cut short; repair it with: scripts/iptm recover"):
        BagReader(small_bag)


def test_every_truncation_is_noticed(small_bag: Path) -> None:
    file = small_bag / "small_0.mcap"
    whole = file.read_bytes()
    for length in range(8, len(whole), 97):
        file.write_bytes(whole[:length])
        for path in (small_bag, file):
            with pytest.raises(BagError, match="iptm recover"):
                BagReader(path)


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n", b"a,b\n1,2\n" * 50])
def test_foreign_file(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(BagError, match="not an MCAP file"):
        BagReader(tmp_path / "x.mcap")


def test_mcap_of_another_profile(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros1")
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(BagError, match=r"'ros1'; only 'ros2'"):
        BagReader(path)


def test_mcap_with_json_messages(tmp_path: Path) -> None:
    path = tmp_path / "json.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        schema = writer.register_schema("x", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/x", "json", schema), 0, b"{}", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(BagError, match="only cdr"):
        BagReader(path)


def test_damage_inside_the_file_is_noticed_while_reading(small_bag: Path) -> None:
    file = small_bag / "small_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"\x00\x00\x00\x00\x00\x00\x08\x40")] ^= 0x01  # the number 3.0
    file.write_bytes(bytes(data))
    with BagReader(small_bag) as reader, pytest.raises(BagError, match=r"damaged.*iptm recover"):
        list(reader.messages())


def test_bag_of_another_writer(tmp_path: Path, encode: Encode) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsWriter(tmp_path / "other", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/a", FLOAT, typestore=store)
        for k in range(5):
            writer.write(connection, k, encode(k))
    with BagReader(tmp_path / "other") as reader:
        assert [m.message.data for m in reader.messages()] == [0.0, 1.0, 2.0, 3.0, 4.0]
        assert reader.run_information().git_revision == "unknown"


def test_type_of_ones_own(tmp_path: Path) -> None:
    text = (
        "std_msgs/Float64 level\nint32 count\n"
        + "=" * 80
        + "\nMSG: std_msgs/Float64\nfloat64 data\n"
    )
    definition = MessageDefinition("own_msgs/msg/Tank", text, "")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "own_msgs/msg/Tank"))
    tank = store.types["own_msgs/msg/Tank"](store.types[FLOAT](2.5), 7)
    data = bytes(store.serialize_cdr(tank, "own_msgs/msg/Tank"))
    with BagWriter(tmp_path / "own") as writer:
        topic = writer.add_topic("/tank", "own_msgs/msg/Tank", definition=definition)
        writer.write(topic, data, 1)
    with BagReader(tmp_path / "own") as reader:
        message = next(reader.messages()).message
    assert (message.level.data, message.count) == (2.5, 7)


def test_bytes_that_do_not_fit_their_type(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(writer.add_topic("/a", FLOAT), b"\x00\x01\x00\x00\x01", 42)
    with (
        BagReader(tmp_path / "bag") as reader,
        pytest.raises(BagError, match=r"/a at 42 ns: 5 bytes"),
    ):
        list(reader.messages())


def test_topic_by_relative_name(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("/car_1/plant/odometry", "/car_2/plant/odometry", "/car_1/clock"):
            writer.add_topic(name, FLOAT)
    with BagReader(tmp_path / "bag") as reader:
        assert reader.resolve("clock").name == "/car_1/clock"
        assert reader.resolve("/car_2/plant/odometry").name == "/car_2/plant/odometry"
        with pytest.raises(BagError, match="several topics"):
            reader.resolve("plant/odometry")
        with pytest.raises(BagError, match=r"no topic '/clock'; its topics are: /car_1/clock"):
            reader.resolve("/clock")
        with pytest.raises(BagError, match=r"is std_msgs/msg/Float64; allowed: rosgraph_msgs"):
            reader.resolve("clock", "rosgraph_msgs/msg/Clock")
        with pytest.raises(BagError, match="no topic 'x'"):
            list(reader.raw_messages(["x"]))
        with pytest.raises(BagError, match="full name"):
            list(reader.raw_messages(["clock"]))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "does not describe a bag"),
        ("- 1", "does not describe a bag"),
        ("{", "not valid YAML"),
        ("rosbag2_bagfile_information: {storage_identifier: mcap}", "names no file"),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [no.mcap]}",
            "missing",
        ),
    ],
)
def test_malformed_metadata(text: str, reason: str, small_bag: Path) -> None:
    (small_bag / "metadata.yaml").write_text(text)
    with pytest.raises(BagError, match=reason):
        BagReader(small_bag)


def test_malformed_run_information(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", custom_data={"seed": "many"}):
        pass
    with (
        BagReader(tmp_path / "bag") as reader,
        pytest.raises(BagError, match="seed of the run is 'many'"),
    ):
        reader.run_information()


def without_a_chunk(file: Path, *, checksum: bool) -> None:
    """Change one byte of the summary: the entry of a chunk becomes a record that readers skip."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[0]
    place = struct.pack(
        "<QQQ", chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset
    )
    data = bytearray(file.read_bytes())
    data[data.index(place) - 9] = 0x88
    if not checksum:
        data[-12:-8] = bytes(4)  # of the summary: other writers leave it out
    file.write_bytes(data)


@pytest.fixture
def chunked_bag(tmp_path: Path, encode: Encode) -> Path:
    with BagWriter(tmp_path / "chunked", chunk_bytes=200) as writer:
        topic = writer.add_topic("/a", FLOAT)
        for k in range(40):
            writer.write(topic, encode(k), k)
    return tmp_path / "chunked"


@pytest.mark.parametrize("checksum", [True, False])
def test_messages_that_the_summary_hides_are_missed(chunked_bag: Path, *, checksum: bool) -> None:
    without_a_chunk(chunked_bag / "chunked_0.mcap", checksum=checksum)
    with (
        pytest.raises(BagError, match=r"damaged .*(checksum|by its statistics it holds 40)"),
        BagReader(chunked_bag) as reader,
    ):
        list(reader.raw_messages(["/a"]))


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_damaged_compressed_chunk_is_one_sentence(
    compression: str, tmp_path: Path, encode: Encode
) -> None:
    with BagWriter(tmp_path / "bag", compression=compression) as writer:
        topic = writer.add_topic("/a", FLOAT)
        for k in range(200):
            writer.write(topic, encode(k), k)
    file = tmp_path / "bag" / "bag_0.mcap"
    whole = file.read_bytes()
    start = whole.index(compression.encode()) + len(compression) + 8
    for offset in range(0, 60, 3):
        file.write_bytes(whole[: start + offset] + b"\x5a\xa5" + whole[start + offset + 2 :])
        with (
            BagReader(tmp_path / "bag") as reader,
            pytest.raises(BagError, match=r"damaged.*iptm recover"),
        ):
            list(reader.raw_messages())


def test_texts_about_the_run_are_covered_by_a_checksum(small_bag: Path) -> None:
    file = small_bag / "small_0.mcap"
    file.write_bytes(file.read_bytes().replace(b"\x01\0\0\x007", b"\x01\0\0\x008", 1))
    with BagReader(small_bag) as reader, pytest.raises(BagError, match="do not match"):
        reader.run_information()


def test_metadata_that_promises_more_messages(small_bag: Path) -> None:
    edit_metadata(small_bag, message_count=41)
    with pytest.raises(BagError, match=r"states 41 messages, its files hold 40"):
        BagReader(small_bag)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "&a [x, x]\n" + "".join(f"- &a{k} [*a, *a, *a]\n" for k in range(3)),
        "a: &a [1, *a]",
        "x" * 600_000,
    ],
    ids=["depth", "broken", "itself", "size"],
)
def test_hostile_metadata_is_one_sentence(text: str, small_bag: Path) -> None:
    (small_bag / "metadata.yaml").write_text(text)
    with pytest.raises(BagError) as caught:
        BagReader(small_bag)
    assert "\n" not in str(caught.value)


def test_a_name_no_file_can_have(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="too long"):
        BagReader(tmp_path / ("x" * 300))

"""Bags of other storages: what was recorded comes back, and damage is one sentence."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from iptm_core.errors import BagError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.recording.bag_info import main as bag_info
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.compare_bags import compare_bags
from iptm_ros.recording.recorded_topics import DEFAULT_QOS
from iptm_ros.recording.recover import recover
from iptm_ros.recording.trajectory_reader import read_trajectory

LATCHED = DEFAULT_QOS._replace(depth=1, durability=QosDurability.TRANSIENT_LOCAL)
FLOAT = "std_msgs/msg/Float64"
NONE, FILE, MESSAGE = CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE
STORAGES = [
    (StoragePlugin.SQLITE3, NONE),
    (StoragePlugin.SQLITE3, FILE),
    (StoragePlugin.SQLITE3, MESSAGE),
    (StoragePlugin.MCAP, FILE),
    (StoragePlugin.MCAP, MESSAGE),
]


def stored(bag: Path, folder: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    """Write the messages of a bag once more, as rosbag2 would have stored them."""
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with BagReader(bag) as reader, writer:
        for key, text in reader.custom_data.items():
            writer.set_custom_data(key, text)
        connections = {
            topic.name: writer.add_connection(
                topic.name,
                topic.type_name,
                typestore=get_typestore(Stores.ROS2_JAZZY),
                offered_qos_profiles=[LATCHED],
            )
            for topic in reader.topics.values()
        }
        for message in reader.raw_messages():
            writer.write(connections[message.topic], message.log_time_ns, message.data)
    return folder


@pytest.fixture(params=STORAGES, ids=lambda p: f"{p[0].name}-{p[1].name}".lower())
def other_bag(small_bag: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Hold what `small_bag` holds, in another storage."""
    return stored(small_bag, tmp_path / "other", *request.param)


def test_every_storage_gives_the_same_messages(small_bag: Path, other_bag: Path) -> None:
    (file,) = (path for path in other_bag.iterdir() if path.name != "metadata.yaml")
    with (
        BagReader(small_bag) as expected,
        BagReader(other_bag) as folder,
        BagReader(file) as single,
    ):
        messages = [(*astuple(message)[:3], message.data) for message in expected.raw_messages()]
        for reader in (folder, single):
            found = [(*astuple(message)[:3], message.data) for message in reader.raw_messages()]
            assert found == messages
            assert (reader.start_ns, reader.end_ns) == (expected.start_ns, expected.end_ns)
            assert reader.topics["/a"].message_count == 20
            assert reader.topics["/a"].is_latched
            part = [m.message.data for m in reader.messages(["/a"], 5 * 10**9, 8 * 10**9)]
            assert part == [5.0, 6.0, 7.0]
            reader.verify()
        assert folder.run_information() == expected.run_information()


def test_a_run_of_the_suite_comes_back_from_sqlite(
    trajectory: Trajectory,
    write_run: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = write_run(tmp_path / "bag", trajectory)
    other = stored(bag, tmp_path / "other", StoragePlugin.SQLITE3, MESSAGE)
    expected, found = read_trajectory(bag), read_trajectory(other)
    for name in TRAJECTORY_COLUMNS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert all(topic.agrees for topic in compare_bags(bag, other))
    assert bag_info([str(other)]) == 0
    assert "age of the preview" in capsys.readouterr().out


def test_unpacking_leaves_nothing_behind(
    small_bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = stored(small_bag, tmp_path / "other", StoragePlugin.SQLITE3, FILE)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    with BagReader(bag) as reader:
        assert list((tmp_path / "temporary").iterdir()) == []
        assert len(list(reader.raw_messages())) == 40


def test_a_metadata_file_that_promises_more(other_bag: Path) -> None:
    path = other_bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"]["message_count"] = 41
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(BagError, match="states 41 messages, its files hold 40"):
        BagReader(other_bag)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"storage_identifier": "tape"}, "stored as 'tape'; allowed: mcap, sqlite3"),
        ({"compression_mode": "FILE", "compression_format": "lzma"}, "'lzma'; allowed: zstd"),
        ({"compression_mode": "TWICE"}, "'TWICE'; allowed: FILE, MESSAGE"),
    ],
)
def test_storages_that_are_not_read(change: dict[str, str], message: str, small_bag: Path) -> None:
    path = small_bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"].update(change)
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(BagError, match=message):
        BagReader(small_bag)


def test_an_sqlite_recording_that_was_killed(small_bag: Path, tmp_path: Path) -> None:
    """What still stands in the journal must not be missing in silence."""
    folder = stored(small_bag, tmp_path / "other", StoragePlugin.SQLITE3, NONE)
    file = folder / "other.db3"
    file.with_name("other.db3-wal").write_bytes(b"messages")
    with pytest.raises(BagError, match=r"journal other.db3-wal: its recording was cut short"):
        BagReader(folder)
    file.with_name("other.db3-wal").unlink()
    (folder / "metadata.yaml").unlink()
    with pytest.raises(BagError, match=r"no metadata.yaml; name its file .*other.db3 itself"):
        BagReader(folder)


def test_an_sqlite_file_of_an_old_distribution(small_bag: Path, tmp_path: Path) -> None:
    """Foxy stored neither definitions nor hashes, Eloquent no quality of service, either."""
    file = stored(small_bag, tmp_path / "other", StoragePlugin.SQLITE3, NONE) / "other.db3"
    with sqlite3.connect(file) as database:
        for table in ("schema", "metadata", "message_definitions"):
            database.execute(f"DROP TABLE {table}")
        for column in ("type_description_hash", "offered_qos_profiles"):
            database.execute(f"ALTER TABLE topics DROP COLUMN {column}")
    database.close()
    with BagReader(file) as reader:
        assert [m.message.data for m in reader.messages(["/b"])] == [-float(k) for k in range(20)]


def test_messages_of_no_topic_are_missed(small_bag: Path, tmp_path: Path) -> None:
    file = stored(small_bag, tmp_path / "other", StoragePlugin.SQLITE3, NONE) / "other.db3"
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM topics WHERE name = '/b'")
    database.close()
    with pytest.raises(BagError, match="20 messages belong to no topic"):
        BagReader(file)


def test_messages_packed_one_by_one_are_recovered_as_plain_ones(
    small_bag: Path, tmp_path: Path
) -> None:
    """So that every tool can read them."""
    (file,) = stored(small_bag, tmp_path / "other", StoragePlugin.MCAP, MESSAGE).glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-200])
    report = recover(file, tmp_path / "new")
    with BagReader(small_bag) as reader:
        expected = [message.data for message in reader.raw_messages()]
    with (tmp_path / "new" / "new_0.mcap").open("rb") as stream:
        found = [message.data for _, _, message in make_reader(stream).iter_messages()]
    assert found == expected
    assert report.message_count == 40


@pytest.fixture
def ros1_bag(tmp_path: Path) -> Path:
    """Hold a latched float, stamped temperatures, a radar of ROS 1 and a type of one's own."""
    store = get_typestore(Stores.ROS1_NOETIC)
    own_text = f"Header header\nfloat64[] levels\nduration age\n{'=' * 80}\nMSG: std_msgs/Header\n"
    own_text += "uint32 seq\ntime stamp\nstring frame_id\n"
    store.register(get_types_from_msg(own_text, "own_msgs/msg/Tank"))
    kinds = store.types
    stamps = [kinds["builtin_interfaces/msg/Time"](sec, 5) for sec in range(3)]
    headers = [kinds["std_msgs/msg/Header"](7, stamp, "pack") for stamp in stamps]
    duration = kinds["builtin_interfaces/msg/Duration"](1, 2)
    with Ros1Writer(tmp_path / "old.bag") as writer:
        connections = {
            name: writer.add_connection(name, type_name, typestore=store, latching=latching)
            for name, type_name, latching in (
                ("/gain", FLOAT, 1),
                ("/cell", "sensor_msgs/msg/Temperature", None),
                ("/radar", "sensor_msgs/msg/Range", None),
                ("/tank", "own_msgs/msg/Tank", None),
            )
        }
        for k, header in enumerate(headers):
            messages = {
                "/gain": kinds[FLOAT](float(k)),
                "/cell": kinds["sensor_msgs/msg/Temperature"](header, 25.0 + k, 0.0),
                "/radar": kinds["sensor_msgs/msg/Range"](header, 1, 0.5, 1.0, 150.0, 30.0 + k),
                "/tank": kinds["own_msgs/msg/Tank"](header, np.arange(k, dtype=float), duration),
            }
            for name, message in messages.items():
                connection = connections[name]
                data = store.serialize_ros1(message, connection.msgtype)
                writer.write(connection, 10**9 * (k + 1), bytes(data))
    return tmp_path / "old.bag"


def test_a_bag_of_ros_1(ros1_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with BagReader(ros1_bag) as reader:
        found = {name: [m.message for m in reader.messages([name])] for name in reader.topics}
        assert [topic.is_latched for topic in reader.topics.values()] == [True, False, False, False]
        assert (reader.start_ns, reader.end_ns, reader.message_count) == (10**9, 3 * 10**9, 12)
        (remark,) = reader.remarks
        assert remark.startswith("sensor_msgs/msg/Range has other fields in ROS 1")
    assert [m.data for m in found["/gain"]] == [0.0, 1.0, 2.0]
    assert [m.temperature for m in found["/cell"]] == [25.0, 26.0, 27.0]
    assert [(m.header.stamp.sec, m.header.stamp.nanosec) for m in found["/cell"]] == [
        (0, 5),
        (1, 5),
        (2, 5),
    ]
    assert [m.header.frame_id for m in found["/cell"]] == ["pack"] * 3
    assert [(m.range, m.variance) for m in found["/radar"]] == [
        (30.0, 0.0),
        (31.0, 0.0),
        (32.0, 0.0),
    ]
    assert [list(m.levels) for m in found["/tank"]] == [[], [0.0], [0.0, 1.0]]
    assert (found["/tank"][0].age.sec, found["/tank"][0].age.nanosec) == (1, 2)
    assert bag_info([str(ros1_bag)]) == 0
    assert "Range has other fields" in " ".join(capsys.readouterr().out.split())


def read_all(path: Path) -> list[tuple[object, ...]]:
    with BagReader(path) as reader:
        reader.verify()
        return [astuple(message) for message in reader.messages()]


@pytest.mark.parametrize("kind", ["db3", "db3.zstd", "mcap.zstd", "bag"])
def test_no_damage_is_more_than_one_sentence(
    kind: str, small_bag: Path, ros1_bag: Path, tmp_path: Path
) -> None:
    """Cuts are noticed wherever they are; of changed bytes, what no checksum covers may pass."""
    if kind == "bag":
        file = ros1_bag
    else:
        plugin = StoragePlugin.MCAP if kind.startswith("mcap") else StoragePlugin.SQLITE3
        mode = FILE if kind.endswith("zstd") else NONE
        file = next(stored(small_bag, tmp_path / "other", plugin, mode).glob(f"*.{kind}"))
    whole = file.read_bytes()
    assert len(read_all(file)) == (12 if kind == "bag" else 40)
    generator = np.random.default_rng(5)
    for cut in generator.choice(len(whole), 15, replace=False).tolist():
        file.write_bytes(whole[:cut])
        with pytest.raises(BagError) as caught:
            read_all(file)
        assert "\n" not in str(caught.value)
    for place in generator.choice(len(whole), 50, replace=False).tolist():
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0xA5]) + whole[place + 1 :])
        with suppress(BagError):  # anything else fails the test
            read_all(file)

"""Every complete message of a bag that was cut or damaged is recovered, and losses are reported."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import ChunkIndex, Message

from iptm_bags import command
from iptm_bags.recover import recover
from iptm_bags.salvage import MAGIC, SalvageReader
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.storage import BagMessage

FLOAT = "std_msgs/msg/Float64"
Encode = Callable[[float], bytes]


def messages_of(path: Path) -> list[BagMessage]:
    with BagReader(path) as reader:
        return list(reader.raw_messages())


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[bytes, list[BagMessage]]]:
    """Bytes and messages of a bag with several chunks, by compression."""
    result = {}
    for compression in ("none", "lz4", "zstd"):
        folder = tmp_path_factory.mktemp("source") / "bag"
        with BagWriter(
            folder, custom_data={"seed": "3"}, compression=compression, chunk_bytes=900
        ) as writer:
            a = writer.add_topic("/a", FLOAT)
            for k in range(60):
                writer.write(a, bytes([0, 1, 0, 0]) + k.to_bytes(8, "little"), k, k + 1)
            text = writer.add_topic("/text", "std_msgs/msg/String")
            for k in range(20):
                body = bytes(4 * k)
                data = bytes([0, 1, 0, 0]) + (len(body) + 1).to_bytes(4, "little") + body + b"\0"
                writer.write(text, data, 60 + k)
        result[compression] = ((folder / "bag_0.mcap").read_bytes(), messages_of(folder))
    return result


def cut(folder: Path, data: bytes) -> Path:
    folder.mkdir(parents=True)
    (folder / "bag_0.mcap").write_bytes(data)
    return folder


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_every_cut_gives_a_sound_bag_with_a_prefix_of_the_messages(
    compression: str,
    data: st.DataObject,
    content: dict[str, tuple[bytes, list[BagMessage]]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    whole, messages = content[compression]
    length = data.draw(st.integers(0, len(whole)), label="bytes kept")
    folder = tmp_path_factory.mktemp("cut")
    source = cut(folder / "bag", whole[:length])
    try:
        report = recover(source)
    except BagError:
        assert list(folder.iterdir()) == [source], "a failed recovery leaves something behind"
        assert compression != "none" or length < 2000
        return
    saved = messages_of(report.output)
    assert saved == messages[: len(saved)]
    assert len(saved) == report.message_count > 0
    assert report.total_bytes == length
    assert 0 <= report.dropped_bytes <= length
    assert report.was_complete == (length == len(whole))
    assert (source / "bag_0.mcap").read_bytes() == whole[:length], "the source was changed"


def test_every_complete_message_is_found_at_every_cut(
    tmp_path: Path,
    encode: Encode,
) -> None:
    """Uncompressed, a message is complete as soon as its last byte is there."""
    with BagWriter(tmp_path / "bag") as writer:
        topic = writer.add_topic("/a", FLOAT)
        for k in range(12):
            writer.write(topic, encode(k), k, 100 + k)
            if k % 4 == 3:
                writer.flush()
    whole, messages = (tmp_path / "bag" / "bag_0.mcap").read_bytes(), messages_of(tmp_path / "bag")
    ends = []
    for message in messages:
        # Each message record is found once: its data is unique together with its times.
        times = struct.pack("<QQ", message.log_time_ns, message.publish_time_ns)
        ends.append(whole.index(times + message.data) + len(times) + len(message.data))
    path = tmp_path / "cut.mcap"
    for length in range(len(MAGIC), ends[-1] + 50):
        path.write_bytes(whole[:length])
        reader = SalvageReader(path)
        found = [record for record in reader.records() if isinstance(record, Message)]
        expected = messages[: bisect_right(ends, length)]
        assert [m.data for m in found] == [m.data for m in expected], length
        if length in ends:
            assert reader.dropped_bytes == 0


def test_report_tells_topics_bytes_and_damage(
    content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, _ = content["none"]
    report = recover(cut(tmp_path / "bag", whole[: len(whole) // 3]))
    text = str(report)
    assert f"{report.message_counts['/a']}  /a" in text
    assert f"of {len(whole) // 3} bytes dropped" in text
    assert "never finished" in text


def test_information_about_the_run_is_kept(
    content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, _ = content["none"]
    report = recover(cut(tmp_path / "bag", whole[:2000]), tmp_path / "saved")
    with BagReader(tmp_path / "saved") as reader:
        assert reader.custom_data == {"seed": "3"}
        assert reader.topics["/a"].type_hash.startswith("RIHS01_")
    assert report.output == tmp_path / "saved"


def test_single_file_and_whole_bag(small_bag: Path, tmp_path: Path) -> None:
    report = recover(small_bag / "small_0.mcap", tmp_path / "copy")
    assert report.was_complete
    assert report.dropped_bytes == 0
    assert messages_of(tmp_path / "copy") == messages_of(small_bag)


def test_zeros_at_the_end_are_dropped(small_bag: Path, tmp_path: Path) -> None:
    """What some file systems leave after a power cut."""
    data = (small_bag / "small_0.mcap").read_bytes()
    with BagReader(small_bag) as reader:
        expected = reader.message_count
    body = data[: data.index(b"rosbag2") - 13]
    report = recover(cut(tmp_path / "zeros", body + bytes(5000)))
    assert report.message_count == expected
    assert report.dropped_bytes == 5000
    assert any("no record starts" in note for note in report.notes)


def test_damaged_chunk_is_left_out_and_said_so(
    content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, messages = content["none"]
    broken = bytearray(whole)
    broken[whole.index(messages[1].data)] ^= 0xFF
    report = recover(cut(tmp_path / "bag", bytes(broken)))
    assert 0 < report.message_count < len(messages)
    assert any("left out" in note for note in report.notes)


def test_garbage_never_raises_anything_unexpected(tmp_path: Path) -> None:
    for seed in range(200):
        garbage = bytes((seed * 7919 + i * i * 31) % 256 for i in range(300))
        with pytest.raises(BagError, match="no complete message"):
            recover(cut(tmp_path / str(seed), MAGIC + garbage))


@pytest.mark.parametrize("first", [b"", b"SQLite format 3\0" + bytes(100), MAGIC[:5]])
def test_foreign_file_is_refused(first: bytes, tmp_path: Path) -> None:
    with pytest.raises(BagError, match="not an MCAP file"):
        recover(cut(tmp_path / "bag", first))
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_missing_source_and_folder_without_files(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="does not exist"):
        recover(tmp_path / "nothing")
    with pytest.raises(BagError, match=r"no \.mcap file"):
        recover(tmp_path)


def test_existing_output_is_refused(small_bag: Path, tmp_path: Path) -> None:
    with pytest.raises(BagError, match="exists already"):
        recover(small_bag, tmp_path)


def test_split_bag_is_joined_in_order(small_bag: Path, tmp_path: Path, encode: Encode) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for number in (2, 10):
        with BagWriter(tmp_path / f"part{number}") as writer:
            topic = writer.add_topic("/a", FLOAT)
            writer.write(topic, encode(number), number)
        part = tmp_path / f"part{number}" / f"part{number}_0.mcap"
        part.rename(folder / f"split_{number}.mcap")
    (small_bag / "small_0.mcap").rename(folder / "split_0.mcap")
    report = recover(folder)
    assert report.message_count == 42
    assert messages_of(report.output)[-1].data == encode(-19)


KILLED_WRITER = """
import sys
from pathlib import Path
from iptm_ros.recording.bag_writer import BagWriter

writer = BagWriter(Path(sys.argv[1]))
topic = writer.add_topic("/a", "std_msgs/msg/Float64")
number = 0
while True:
    writer.write(topic, bytes([0, 1, 0, 0]) + number.to_bytes(8, "little"), number)
    number += 1
    if number % 100 == 0:
        writer.flush()
        print(number, flush=True)
"""


def test_killed_writer_loses_nothing_that_was_flushed(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", KILLED_WRITER, str(tmp_path / "bag")],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        seen = 0
        while seen < 5000:
            seen = int(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        rest = process.stdout.read().split()
    written = int(rest[-1]) if rest else seen
    report = recover(tmp_path / "bag")
    assert written <= report.message_count <= written + 200
    assert [m.log_time_ns for m in messages_of(report.output)] == list(range(report.message_count))


def test_command(
    content: dict[str, tuple[bytes, list[BagMessage]]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = cut(tmp_path / "bag", content["none"][0][:3000])
    assert command.main([str(source), "-o", str(tmp_path / "out")]) == 0
    assert "bytes dropped" in capsys.readouterr().out
    assert command.main([str(source), "-o", str(tmp_path / "out")]) == 1
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_the_report_counts_what_a_damaged_chunk_held(
    compression: str, content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, messages = content[compression]
    with make_chunk_list(whole, tmp_path) as chunks:
        damaged = bytearray(whole)
        middle = chunks[1].chunk_start_offset + chunks[1].chunk_length // 2 + 20
        damaged[middle] ^= 0xFF
    report = recover(cut(tmp_path / "bag", bytes(damaged)))
    lost = len(messages) - report.message_count
    assert 0 < lost == report.lost_count == sum(report.lost_counts.values())
    assert report.is_loss_exact
    assert not report.was_complete
    text = str(report)
    assert f"{lost} messages lost, by the statistics of the source" in text
    assert f"from byte {chunks[1].chunk_start_offset} on left out" in text
    assert f"{lost} messages from" in text


@pytest.mark.parametrize("what", ["opcode", "length"])
def test_recovery_goes_on_behind_damage_of_the_structure(
    what: str, content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, messages = content["none"]
    with make_chunk_list(whole, tmp_path) as chunks:
        damaged = bytearray(whole)
        damaged[chunks[0].chunk_start_offset + (0 if what == "opcode" else 2)] = 0x7F
        held = chunks[1].chunk_start_offset - chunks[0].chunk_start_offset
    report = recover(cut(tmp_path / "bag", bytes(damaged)))
    assert report.dropped_bytes == held
    saved = messages_of(report.output)
    assert saved == messages[-len(saved) :]
    assert report.lost_count == len(messages) - len(saved) > 0


@contextmanager
def make_chunk_list(whole: bytes, folder: Path) -> Iterator[list[ChunkIndex]]:
    """Give the chunks of a file by their place in it."""
    (folder / "whole.mcap").write_bytes(whole)
    with (folder / "whole.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        yield sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_a_chunk_that_occurs_twice_is_taken_over_once(
    compression: str, content: dict[str, tuple[bytes, list[BagMessage]]], tmp_path: Path
) -> None:
    whole, messages = content[compression]
    with make_chunk_list(whole, tmp_path) as chunks:
        start = chunks[1].chunk_start_offset
        end = start + chunks[1].chunk_length
    bag = cut(tmp_path / "repeated", whole[:end] + whole[start:end] + whole[end:])
    report = recover(bag, tmp_path / "recovered")
    assert messages_of(tmp_path / "recovered") == messages
    assert f"chunk at byte {end} occurs before and is left out" in report.notes
    assert not report.was_complete

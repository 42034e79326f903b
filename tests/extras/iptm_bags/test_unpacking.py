"""A few kilobytes that stand for gigabytes are refused in one line, with little memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.writer import CompressionType, Writer

from iptm_bags.recover import recover
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.storage import (
    LARGEST_RATIO,
    MOST_PART_BYTES,
    SMALL_BYTES,
    UnpackingBudget,
)

MEMORY_MB = 200
_WITH_PEAK = """
import re, sys
from pathlib import Path
from iptm_bags.reading import info
code = info(sys.argv[1:])
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
sys.exit(code)
"""
"""The command `iptm info`, which prints the most memory that it took in kB."""


def _chunk_bomb(path: Path, size: int, compression: CompressionType) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=1 << 20)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/t", "cdr", schema, {})
        writer.add_message(channel, 1, bytes(size), 1, 0)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_unpacks_to_too_much_is_refused_and_not_recovered(
    tmp_path: Path, compression: CompressionType
) -> None:
    bomb = _chunk_bomb(tmp_path / "x.mcap", 2 * MOST_PART_BYTES, compression)
    with pytest.raises(BagError, match="unpacks to"):
        BagReader(bomb)
    with pytest.raises(BagError, match="nothing to recover"):
        recover(bomb, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_large_chunk_below_the_bound_is_read(
    tmp_path: Path, compression: CompressionType
) -> None:
    path = _chunk_bomb(tmp_path / "x.mcap", MOST_PART_BYTES - 1000, compression)
    with BagReader(path) as reader:
        (message,) = reader.raw_messages()
    assert len(message.data) == MOST_PART_BYTES - 1000


def test_a_frame_that_states_another_size_than_its_chunk_is_refused(tmp_path: Path) -> None:
    # The record says one kilobyte, the frame of zstd inside of it 64 MB.
    bomb = _chunk_bomb(tmp_path / "x.mcap", 2 * MOST_PART_BYTES, CompressionType.ZSTD)
    size = 2 * MOST_PART_BYTES + 150
    content = bytearray(bomb.read_bytes())
    for wrong in range(size - 200, size + 200):
        content = content.replace(wrong.to_bytes(8, "little"), (1024).to_bytes(8, "little"), 1)
    bomb.write_bytes(content)
    with pytest.raises(BagError):
        BagReader(bomb)
    with pytest.raises(BagError, match="nothing to recover"):
        recover(bomb, tmp_path / "out")


@pytest.mark.slow
def test_gigabytes_take_little_memory_time_and_one_line(tmp_path: Path) -> None:
    bomb = _chunk_bomb(tmp_path / "x.mcap", 10**9, CompressionType.ZSTD)
    found = subprocess.run(
        [sys.executable, "-c", _WITH_PEAK, str(bomb)],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert found.returncode == 2
    assert len(found.stderr.strip().splitlines()) == 1
    assert int(found.stdout) / 1024 < MEMORY_MB


def test_the_budget_of_a_file_grows_with_its_size() -> None:
    large = SMALL_BYTES  # of the packed file
    UnpackingBudget(large).take(LARGEST_RATIO * large)
    with pytest.raises(ValueError, match="unpacks to more"):
        UnpackingBudget(large).take(LARGEST_RATIO * large + 1)


def test_a_file_that_is_named_twice_is_refused(small_bag: Path) -> None:
    path = small_bag / "metadata.yaml"
    metadata = yaml.safe_load(path.read_text())
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] *= 2000
    path.write_text(yaml.safe_dump(metadata))
    with pytest.raises(BagError, match="twice"):
        BagReader(small_bag)


@pytest.fixture
def long_texts(tmp_path: Path, encode: Any) -> Path:
    """A bag whose texts about the run have 3 MB, without metadata.yaml."""
    folder = tmp_path / "long"
    with BagWriter(folder, custom_data={"scenario": "s", "parameters": "a" * 3_000_000}) as writer:
        topic = writer.add_topic("/a", "std_msgs/msg/Float64")
        writer.write(topic, encode(1.0), 1)
    (folder / "metadata.yaml").unlink()
    return folder / "long_0.mcap"


def test_texts_that_nothing_can_read_are_left_out_of_a_recovered_bag(
    long_texts: Path, tmp_path: Path
) -> None:
    with pytest.raises(BagError, match="at most"):
        BagReader(long_texts)
    report = recover(long_texts, tmp_path / "out")
    assert report.message_counts == {"/a": 1}
    assert any("texts of" in note for note in report.notes)
    with BagReader(tmp_path / "out") as reader:
        assert len(list(reader.raw_messages())) == 1


def test_texts_too_long_for_metadata_are_left_out_shortest_kept(
    tmp_path: Path, encode: Any
) -> None:
    folder = tmp_path / "long"
    with BagWriter(folder, custom_data={"parameters": "a" * 600_000, "scenario": "s"}) as writer:
        topic = writer.add_topic("/a", "std_msgs/msg/Float64")
        writer.write(topic, encode(1.0), 1)
    report = recover(folder / "long_0.mcap", tmp_path / "out")
    assert any("'parameters'" in note for note in report.notes)
    with BagReader(tmp_path / "out") as reader:
        assert reader.run_information().scenario == "s"
        assert not reader.run_information().parameters


def test_a_definition_with_an_unknown_type_is_no_traceback(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        schema = writer.register_schema("own/msg/A", "ros2msg", b"Foo x\n")
        channel = writer.register_channel("/t", "cdr", schema, {})
        writer.add_message(channel, 1, b"\0\1\0\0" + bytes(8), 1, 0)
        writer.finish()
    report = recover(path, tmp_path / "out")
    assert report.message_counts == {"/t": 1}


def test_a_full_disk_leaves_no_folder_behind(small_bag: Path, tmp_path: Path) -> None:
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000));"
        "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "from iptm_bags.command import main; sys.exit(main(sys.argv[1:]))"
    )
    output = tmp_path / "out"
    arguments = [str(small_bag), "-o", str(output)]
    found = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False
    )
    assert found.returncode == 1
    assert "cannot" in found.stderr
    assert len(found.stderr.strip().splitlines()) == 1
    assert not output.exists()

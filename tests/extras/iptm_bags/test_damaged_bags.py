"""Bags damaged as disks, networks and people damage files, given to every reader: no loss without a report.

Every reader ends by itself, with one sentence or with the truth: a bag that passes as sound holds the very
messages of the original, and what `iptm recover` leaves out it reports exactly. The long version
(`scripts/test -m slow`) tries 1,000 bags.
"""

from __future__ import annotations

import contextlib
import io
import random
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_bags.bag_damage import CORRUPTIONS

from iptm_bags import reading
from iptm_bags.playback import Playback, PlaybackOptions
from iptm_bags.recover import recover
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import COMPRESSIONS, BagWriter
from iptm_ros.recording.storage import BagMessage
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory

EXAMPLE = Path(__file__).resolve().parents[3] / "bags" / "example_us06_120s"
LENGTH_S = 8.0
CHUNK_BYTES = 6 * 1024
TIMEOUT_S = 120


@dataclass(frozen=True)
class Original:
    """A sound bag and what it holds."""

    folder: Path
    messages: list[BagMessage]
    custom_data: dict[str, str]
    columns: list[dict[str, Any]]


def make_original(folder: Path, compression: str) -> Original:
    """Write the first seconds of the example bag again, in many small chunks."""
    with (
        BagReader(EXAMPLE) as example,
        BagWriter(
            folder,
            custom_data=example.custom_data,
            compression=compression,
            chunk_bytes=CHUNK_BYTES,
        ) as writer,
    ):
        ids = {
            topic.name: writer.add_topic(topic.name, topic.type_name, offered_qos=topic.offered_qos)
            for topic in example.topics.values()
        }
        end_ns = example.start_ns + round(LENGTH_S * 1e9)
        for message in example.raw_messages(end_ns=end_ns):
            times = (message.log_time_ns, message.publish_time_ns)
            writer.write(ids[message.topic], message.data, *times)
    with BagReader(folder) as reader:
        return Original(folder, list(reader.raw_messages()), reader.custom_data, columns_of(folder))


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Original]:
    folder = tmp_path_factory.mktemp("originals")
    return {name: make_original(folder / name / "run", name) for name in COMPRESSIONS}


def command(main: Callable[[Sequence[str]], int], *arguments: Path) -> int:
    """Run a command as a user does; its error message becomes the error."""
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        code = main([str(argument) for argument in arguments])
    if code == 2:
        raise BagError(errors.getvalue().strip())
    return code


def columns_of(bag: Path) -> list[dict[str, Any]]:
    return [read_trajectory(bag).to_arrays(), read_decisions(bag).to_arrays()]


def check_bag_info(bag: Path, original: Original) -> None:
    command(reading.info, bag)
    with BagReader(bag) as reader:
        assert list(reader.raw_messages()) == original.messages, "other messages, exit code 0"
        assert reader.custom_data == original.custom_data, "other texts, exit code 0"


def check_file(bag: Path, original: Original) -> None:
    check_bag_info(bag / "run_0.mcap", original)


def check_comparison(bag: Path, original: Original) -> None:
    if (
        command(
            reading.compare, Path("--exact"), original.folder, bag, Path("--exclude"), Path("/none")
        )
        == 0
    ):
        with BagReader(bag) as reader:
            assert sorted(m.data for m in reader.raw_messages()) == sorted(
                m.data for m in original.messages
            ), "reported equal, but the messages differ"


def check_replay(bag: Path, original: Original) -> None:
    with BagReader(bag) as reader:
        played = list(Playback(reader, PlaybackOptions(bag)).messages())
    assert played == original.messages, "other messages are played"


def check_columns(bag: Path, original: Original) -> None:
    for columns, expected in zip(columns_of(bag), original.columns, strict=True):
        for name, values in expected.items():
            assert columns[name].tobytes() == values.tobytes(), f"other {name}"


def check_recovery(bag: Path, original: Original) -> None:
    report = recover(bag, bag.parent / "recovered")
    with BagReader(bag.parent / "recovered") as reader:
        reader.verify()
        saved = Counter(map(content, reader.raw_messages()))
    had = Counter(map(content, original.messages))
    lost = (had - saved).total()
    assert report.message_count == saved.total()
    assert not saved - had, "messages that were never recorded"
    assert report.lost_count == lost if report.is_loss_exact else report.lost_count <= lost
    assert not (lost and report.was_complete), f"{lost} messages lost, but 'complete'"
    assert not lost or report.notes, f"{lost} messages lost without a reason"


def content(message: BagMessage) -> tuple[str, int, int, bytes]:
    return message.topic, message.log_time_ns, message.publish_time_ns, message.data


CHECKS = (
    check_bag_info,
    check_file,
    check_comparison,
    check_replay,
    check_columns,
    check_recovery,
)


def refusal(check: Callable[[Path, Original], None], bag: Path, original: Original) -> str:
    """Return the message of a refusal, empty if the bag was accepted and passed the check."""
    try:
        check(bag, original)
    except BagError as error:
        message = str(error)
    else:
        return ""
    assert message.count("\n") == 0 < len(message), f"not one sentence: {message!r}"
    return message


@pytest.fixture
def _time_limit() -> Iterator[None]:
    """Fail a reader that does not end."""

    def expired(*_: object) -> None:
        pytest.fail(f"a reader did not end within {TIMEOUT_S} s")

    before = signal.signal(signal.SIGALRM, expired)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


QUICK_SEEDS = (*range(9), 562, 997)
"""The last two damage the statistics: before, 3e19 messages were reported as lost."""


@pytest.mark.usefixtures("_time_limit")
@pytest.mark.parametrize(
    "seeds", [QUICK_SEEDS, pytest.param(range(1000), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_every_reader_ends_with_the_truth_or_one_sentence(
    seeds: Iterable[int], originals: dict[str, Original], tmp_path: Path
) -> None:
    for seed in seeds:
        signal.alarm(TIMEOUT_S)
        print("seed", seed)
        rng = random.Random(f"1 {seed}")  # noqa: S311
        original = originals[list(COMPRESSIONS)[seed % len(COMPRESSIONS)]]
        target = "metadata.yaml" if rng.random() < 0.1 else "run_0.mcap"
        bag = tmp_path / str(seed) / "run"
        shutil.copytree(original.folder, bag)
        data = bytearray((bag / target).read_bytes())
        CORRUPTIONS[rng.choice(list(CORRUPTIONS))](data, rng)
        (bag / target).write_bytes(data)
        for check in CHECKS:
            refusal(check, bag, original)
        shutil.rmtree(bag.parent)

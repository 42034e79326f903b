"""Corrupts bags in many ways and gives each to every reader: nothing may be lost without a word.

A short run is stored without compression, with lz4 and with zstd; copies of it are damaged as disks, networks
and people damage files. Every reader has to end by itself, with one sentence or with the truth: a bag that
counts as sound holds the very messages of the original, and what `recover_bag` leaves out it says exactly.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.bag_damage import CORRUPTIONS
from iptm_core.errors import BagError
from iptm_core.markdown import markdown_table
from iptm_recording import bag_info, compare_bags
from iptm_recording.bag_reader import BagReader
from iptm_recording.bag_writer import COMPRESSIONS, BagWriter
from iptm_recording.playback import Playback, PlaybackOptions
from iptm_recording.recover import RecoveryReport, recover
from iptm_recording.storage import RawMessage
from iptm_recording.trajectory_reader import read_decisions, read_trajectory

EXAMPLE = Path(__file__).resolve().parents[1] / "bags" / "example_us06_120s"
LENGTH_S = 8.0
CHUNK_BYTES = 6 * 1024
TIMEOUT_S = 60.0
_TELL_EVERY = 50
_Figures = tuple[dict[str, Any], dict[str, Any]]


@dataclass(frozen=True)
class Original:
    """A sound bag and what it holds."""

    folder: Path
    messages: list[RawMessage]
    custom_data: dict[str, str]
    figures: _Figures


@dataclass
class Campaign:
    """Outcome of a campaign.

    Attributes:
        cases: bags tried.
        outcomes: by reader and outcome.
        failures: what must not happen, each with its case.
        longest_s: longest time that one reader took for one bag.
    """

    cases: int = 0
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    longest_s: float = 0.0

    def note(self, reader: str, outcome: str) -> None:
        """Count an outcome."""
        self.outcomes.setdefault(reader, Counter())[outcome] += 1


class _HangError(Exception):
    """A reader did not end."""


class _SilentError(Exception):
    """A reader passed something off for what it is not."""


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
        return Original(
            folder, list(reader.raw_messages()), reader.custom_data, _read_figures(folder)
        )


def run(cases: int, seed: int, say: Callable[[str], None] | None = None) -> Campaign:
    """Corrupt bags and read them.

    Args:
        cases: how many, over all compressions.
        seed: of everything random.
        say: told about every failure, and now and then how far it is.
    """
    campaign = Campaign()
    with tempfile.TemporaryDirectory() as scratch:
        originals = {
            name: make_original(Path(scratch) / name / "run", name) for name in COMPRESSIONS
        }
        for number in range(cases):
            compression = list(COMPRESSIONS)[number % len(COMPRESSIONS)]
            rng = random.Random(f"{seed} {number}")  # noqa: S311  no secret
            kind = rng.choice(list(CORRUPTIONS))
            target = "metadata.yaml" if rng.random() < 0.1 else "run_0.mcap"
            bag = Path(scratch) / "case" / "run"
            shutil.copytree(originals[compression].folder, bag)
            data = bytearray((bag / target).read_bytes())
            CORRUPTIONS[kind](data, rng)
            (bag / target).write_bytes(data)
            for failure in _try_readers(bag, originals[compression], campaign):
                text = f"case {number} ({compression}, {kind} of {target}): {failure}"
                campaign.failures.append(text)
                if say is not None:
                    say(text)
            campaign.cases += 1
            if say is not None and campaign.cases % _TELL_EVERY == 0:
                say(f"{campaign.cases} bags, {len(campaign.failures)} failures so far")
            shutil.rmtree(bag.parent)
    return campaign


def _try_readers(bag: Path, original: Original, campaign: Campaign) -> Iterator[str]:
    """Give a bag to every reader, whole folder and single file; yield what must not happen."""
    for name, reader in READERS.items():
        began_s = time.monotonic()
        try:
            with _time_limit(), contextlib.redirect_stdout(io.StringIO()):
                outcome = reader(bag, original)
        except BagError as error:
            outcome = "refused"
            if "\n" in str(error) or not str(error):
                yield f"{name}: not one sentence: {error!r}"
        except _HangError:
            outcome = "HANG"
            yield f"{name}: no end within {TIMEOUT_S:g} s"
        except _SilentError as error:
            outcome = "SILENT"
            yield f"{name}: {error}"
        except Exception:  # noqa: BLE001  this is what is looked for
            outcome = "TRACEBACK"
            yield f"{name}: {traceback.format_exc(limit=-4)}"
        campaign.note(name, outcome)
        campaign.longest_s = max(campaign.longest_s, time.monotonic() - began_s)


@contextlib.contextmanager
def _time_limit() -> Iterator[None]:
    def give_up(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise _HangError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, TIMEOUT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _checked(condition: object, text: str) -> None:
    if not condition:
        raise _SilentError(text)


def _command(main: Callable[[Sequence[str]], int], *arguments: Path) -> int:
    """Run a command as a user does; its error message becomes the error.

    Raises:
        BagError: it ended with exit code 2.
    """
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        code = main([str(argument) for argument in arguments])
    if code == 2:
        raise BagError(errors.getvalue().strip())
    return code


def _bag_info(bag: Path, original: Original) -> str:
    _command(bag_info.main, bag)
    with BagReader(bag) as reader:
        _checked(list(reader.raw_messages()) == original.messages, "other messages, exit code 0")
        same = reader.custom_data == original.custom_data
    _checked(same, "other texts about the run, exit code 0")
    return "sound"


def _file(bag: Path, original: Original) -> str:
    return _bag_info(bag / "run_0.mcap", original)


def _compare(bag: Path, original: Original) -> str:
    code = _command(compare_bags.main, original.folder, bag, Path("--exclude"), Path("/none"))
    if code == 0:
        with BagReader(bag) as reader:
            same = Counter(m.data for m in reader.raw_messages())
        _checked(same == Counter(m.data for m in original.messages), "agree, but they do not")
    return "sound" if code == 0 else "differs"


def _replay(bag: Path, original: Original) -> str:
    with BagReader(bag) as reader:
        played = list(Playback(reader, PlaybackOptions(bag)).messages())
    _checked(played == original.messages, "other messages are played")
    return "sound"


def _figures(bag: Path, original: Original) -> str:
    for columns, its_columns in zip(_read_figures(bag), original.figures, strict=True):
        for name, values in its_columns.items():
            _checked(columns[name].tobytes() == values.tobytes(), f"other {name}")
    return "sound"


def _read_figures(bag: Path) -> _Figures:
    return read_trajectory(bag).to_arrays(), read_decisions(bag).to_arrays()


def _recover(bag: Path, original: Original) -> str:
    output = bag.parent / "recovered"
    report = recover(bag, output)
    with BagReader(output) as reader:
        reader.verify()
        saved = Counter(map(_content, reader.raw_messages()))
    had = Counter(map(_content, original.messages))
    _checked(report.message_count == saved.total(), "reports another number of messages")
    _checked(not saved - had, f"{(saved - had).total()} messages that were never recorded")
    lost = (had - saved).total()
    if report.is_loss_exact:
        _checked(report.lost_count == lost, f"{lost} messages lost, reported: {report.lost_count}")
    _checked(report.lost_count <= lost, f"{lost} messages lost, reported: {report.lost_count}")
    _checked(not (lost and report.was_complete), f"{lost} messages lost, but 'complete'")
    _checked(not lost or report.notes, f"{lost} messages lost, without a word on why")
    return _recovery_outcome(report)


def _recovery_outcome(report: RecoveryReport) -> str:
    if report.was_complete:
        return "sound"
    return "loss reported exactly" if report.is_loss_exact else "loss reported as a lower bound"


def _content(message: RawMessage) -> tuple[str, int, int, bytes]:
    return message.topic, message.log_time_ns, message.publish_time_ns, message.data


READERS: dict[str, Callable[[Path, Original], str]] = {
    "bag_info": _bag_info,
    "bag_info of the file": _file,
    "compare_bags": _compare,
    "replay": _replay,
    "table and picture": _figures,
    "recover_bag": _recover,
}


def table(campaign: Campaign) -> str:
    """Return the outcomes as a Markdown table."""
    outcomes = sorted({name for counts in campaign.outcomes.values() for name in counts})
    rows = (
        (reader, *(counts[name] for name in outcomes))
        for reader, counts in campaign.outcomes.items()
    )
    return markdown_table(("reader", *(f"{name}:" for name in outcomes)), rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign; returns 1 if anything happened that must not."""
    parser = argparse.ArgumentParser(prog="corrupt_bags", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="bags (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="default: %(default)s")
    parser.add_argument("--json", type=Path, help="file for the outcomes")
    given = parser.parse_args(arguments)
    campaign = run(given.cases, given.seed, lambda text: print(text, file=sys.stderr, flush=True))
    print(table(campaign))
    print(
        f"{campaign.cases} bags, {len(campaign.failures)} failures; longest single reading:"
        f" {campaign.longest_s:.1f} s"
    )
    if given.json is not None:
        given.json.write_text(json.dumps(vars(campaign), indent=2), encoding="utf-8")
    return 1 if campaign.failures else 0


if __name__ == "__main__":
    sys.exit(main())

"""Frames in a log of a CAN bus, as python-can reads them, and as loggers leave the files."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from iptm_core.errors import RouteError
from iptm_drives.packed import read_content
from iptm_drives.text_table import text_of

MDF_SUFFIXES = (".mf4", ".mdf", ".dat")
"""Files of ASAM; those of version 3 end in the second or third."""
CAN_SUFFIXES = (*MDF_SUFFIXES, ".blf", ".asc", ".log", ".trc", ".csv")
_HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/can.txt"
_MAX_BYTES = 2_000_000_000
_SHOWN_BY_CANDUMP = re.compile(
    r"\s*(\([\d.]+\))\s+(\S+)\s+(?:[RT]X\s+\S\s+\S\s+)?([0-9A-Fa-f]+)\s+\[\d+\]\s+((?:[0-9A-Fa-f]{2}\s*)*)$"
)
_LOGGED_BY_CANDUMP = re.compile(r"\(\d+(\.\d*)?\) \S+ [0-9A-Fa-f]+#\S*( [RTrt])?")
_MOST_BROKEN = 0.2
_STARTED = re.compile(r"(?im)^\s*[\d.]+\s+(CANFD\s+)?Start of measurement.*\n")
_CANEDGE = re.compile(r"TimestampEpoch;BusChannel;ID;IDE;")


def frames_of(path: Path, notes: list[str]) -> Iterator[Any]:
    """Yield the frames of a log without those that hold no data; notes say at the end what was cut."""
    try:
        with _reader(library("can"), path, notes) as log:
            yield from (each for each in log if not (each.is_error_frame or each.is_remote_frame))
            stated = getattr(log, "file_size", 0)
    except RouteError:
        raise
    except Exception as reason:  # the readers have error types of their own
        raise RouteError(f"{path}: cannot be read as a CAN log ({reason})") from reason
    if stated > path.stat().st_size and not path.name.lower().endswith(".gz"):
        notes.append(f"the log was cut short: {path.stat().st_size} of {stated} bytes are there")


def library(name: str) -> Any:
    """Return a library that the extra of the requirements for CAN holds.

    Raises:
        RouteError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise RouteError(f"CAN needs {name}, which is not installed; install: {_HOW_TO}") from None


def _reader(can: Any, path: Path, notes: list[str]) -> Any:
    """Return the reader of python-can for a log; texts lose a last line that was cut."""
    suffix = Path(path.name.lower().removesuffix(".gz")).suffix
    if suffix in {".blf", ".mf4"}:
        return can.LogReader(path)
    text = text_of(read_content(path, _MAX_BYTES)).rstrip("\0")
    if text and not text.endswith(("\n", "\r")):
        text = text[: text.rfind("\n") + 1]
        notes.append("the last line of the log is cut: left out")
    if suffix == ".log":
        return can.CanutilsLogReader(io.StringIO("".join(_candump(path, text.splitlines(), notes))))
    if suffix == ".csv" and _CANEDGE.match(text):
        return _canedge(can, text)
    if suffix == ".asc":
        text = _STARTED.sub("", text)
        if "begin triggerblock" in text.lower() and "end triggerblock" not in text[-2000:].lower():
            notes.append("the log was cut short: its last block has no end")
        blocks = len(re.findall(r"(?im)^begin\s+triggerblock", text))
        if re.search(r"(?im)^base\s+\w+\s+timestamps\s+relative", text[:5000]):
            text = _absolute(text)
        return can.ASCReader(io.StringIO(text), relative_timestamp=blocks < 2)
    return (can.TRCReader if suffix == ".trc" else can.CSVReader)(io.StringIO(text))


def _candump(path: Path, lines: list[str], notes: list[str]) -> Iterator[str]:
    """Yield the lines of candump as its log has them, whichever of its options wrote them."""
    broken = [0, 0]
    for number, line in enumerate(lines, start=1):
        shown = _SHOWN_BY_CANDUMP.match(line)
        text = (
            f"{shown[1]} {shown[2]} {shown[3]}#{''.join(shown[4].split())}"
            if shown
            else line.strip()
        )
        if _LOGGED_BY_CANDUMP.fullmatch(text):
            yield f"{text}\n"
        elif text:
            broken = [broken[0] + 1, broken[1] or number]
    if broken[0] > _MOST_BROKEN * len(lines):
        raise RouteError(
            f"{path}, line {broken[1]}: no frame of candump; allowed: (TIME) CHANNEL ID#DATA"
        )
    if broken[0]:
        notes.append(f"lines without a frame left out: {broken[0]}, the first is line {broken[1]}")


@contextmanager
def _canedge(can: Any, text: str) -> Iterator[Iterator[Any]]:
    """Yield the frames of a table as the tools of CANedge write it."""
    yield (
        can.Message(
            timestamp=float(row["TimestampEpoch"]),
            arbitration_id=int(row["ID"], 16),
            is_extended_id=row["IDE"] == "1",
            channel=row["BusChannel"],
            data=bytes.fromhex(row["DataBytes"]),
            is_fd=row.get("EDL") == "1",
        )
        for row in csv.DictReader(io.StringIO(text), delimiter=";")
    )


def _absolute(text: str) -> str:
    """Return an ASC log with times from its beginning instead of from the line before."""
    at_s, lines = 0.0, []
    for line in text.splitlines(keepends=True):
        stated = re.match(r"\s*(\d+\.\d+)(?=\s)", line)
        if stated:
            at_s += float(stated[1])
            line = f"{at_s:.6f}{line[stated.end() :]}"  # noqa: PLW2901
        lines.append(line)
    return "".join(lines)

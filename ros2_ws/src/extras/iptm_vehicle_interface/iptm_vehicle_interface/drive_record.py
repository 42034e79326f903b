"""A record of a drive: raw frames as a candump log, steps and decisions beside it, and its exact replay.

Everything that makes a difference is a line with its time in whole microseconds, in the order in which it was
taken: frames of the car (``R``) and of the suite (``T``), which any tool for CAN logs reads, and in a second
file steps and decisions as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import Command, FloatArray
from iptm_vehicle_interface.bus import Frame, log_line
from iptm_vehicle_interface.driving import Driver

FRAMES, DECISIONS = "frames.log", "decisions.jsonl"
_DECIMALS = 6


def whole_microseconds(time_s: float) -> float:
    """Return a time as logs of frames hold it."""
    return round(time_s, _DECIMALS)


class DriveRecorder:
    """Writes a record into a folder, which is made."""

    def __init__(self, folder: Path) -> None:
        """Begin a record.

        Raises:
            RouteError: the folder cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._frames: TextIO = (folder / FRAMES).open("w", encoding="ascii")
            self._decisions: TextIO = (folder / DECISIONS).open("w", encoding="ascii")
        except OSError as error:
            raise RouteError(f"{folder}: {error.strerror}; allowed: a folder to write") from error
        self._order = 0

    def received(self, frame: Frame) -> None:
        """Record a frame of the car."""
        self._frame(frame.time_s, frame.frame_id, frame.data, "R", frame.bus)

    def stepped(self, now_s: float, sent: Sequence[tuple[int, bytes]]) -> None:
        """Record a step of the inner loop and the frames that it sends."""
        for frame_id, data in sent:
            self._frame(now_s, frame_id, data, "T")
        self._note("step", now_s, len(sent))

    def ticked(self, tick_s: float, now_s: float) -> None:
        """Record that the state of a tick was taken."""
        self._note("tick", now_s, tick_s)

    def pressed(self, button: str, now_s: float) -> None:
        """Record a request of a service."""
        self._note("press", now_s, button)

    def silenced(self, names: Sequence[str], now_s: float) -> None:
        """Record which processes show no sign of life from now on."""
        self._note("silent", now_s, names)

    def decided(self, tick_s: float, plan: Sequence[FloatArray], command: Command) -> None:
        """Record a decision that is followed."""
        rows = [column.tolist() for column in plan]
        self._note("decision", tick_s, [rows, *vars(command).values()])

    def close(self) -> None:
        """Complete the files."""
        self._frames.close()
        self._decisions.close()

    def _frame(
        self, time_s: float, frame_id: int, data: bytes, direction: str, bus: int = 0
    ) -> None:
        self._frames.write(log_line(time_s, frame_id, data, direction, bus))
        self._order += 1

    def _note(self, kind: str, time_s: float, value: Any) -> None:
        """Record anything but a frame, with the number of frames before it."""
        self._decisions.write(json.dumps([self._order, kind, time_s, value]) + "\n")


def read_frames(path: Path) -> list[tuple[Frame, bool]]:
    """Return the frames of a log with directions, and whether each was received.

    Raises:
        RouteError: the log is missing, or a line of it is malformed.
    """
    found = []
    try:
        lines = path.read_text("ascii").splitlines()
    except OSError as error:
        raise RouteError(f"{path}: {error.strerror}; allowed: the record of a drive") from error
    for number, line in enumerate(lines, start=1):
        try:
            time, channel, frame, direction = line.split()
            identifier, _, data = frame.partition("#")
            data = data[2:] if data.startswith("#") else data  # flags of a frame of CAN FD
            place = int(identifier, 16), bytes.fromhex(data), float(time.strip("()"))
            each = Frame(*place, bus=int(channel.removeprefix("car") or 0))
        except ValueError:
            raise RouteError(
                f"{path}, line {number}: {line!r}; allowed: (time) bus ID#DATA R or T"
            ) from None
        found.append((each, direction == "R"))
    return found


def replayed(folder: Path, driver: Driver) -> Iterator[tuple[float, bytes, bytes]]:
    """Replay a record through the interface; yield time, recorded and computed data of each frame sent.

    Args:
        driver: a new one, of the same vehicle.

    Raises:
        RouteError: the record is malformed.
    """
    frames, taken = read_frames(folder / FRAMES), 0
    path = folder / DECISIONS
    for number, line in enumerate(path.read_text("ascii").splitlines(), start=1):
        try:
            order, kind, time_s, value = json.loads(line)
            sent = value if kind == "step" else 0
        except ValueError:
            raise RouteError(f"{path}, line {number}: {line[:60]!r}; allowed: JSON") from None
        for frame, _ in frames[taken : order - sent]:
            driver.receive(frame)
        taken = order
        if kind == "tick":
            driver.measured(value, time_s)
        elif kind == "press":
            driver.press(value, time_s)
        elif kind == "silent":
            driver.note_silent(value)
        elif kind == "decision":
            plan = [np.array(column, np.float64) for column in value[0]]
            driver.follow(time_s, plan, Command(*value[1:]))
        else:
            recorded = [frame for frame, _ in frames[order - sent : order]]
            for was, (_, data) in zip(recorded, driver.step(time_s), strict=True):
                yield time_s, was.data, data

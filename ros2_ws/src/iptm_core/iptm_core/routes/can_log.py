"""Drives in logs of a vehicle's CAN bus (MF4, BLF, ASC): the signals that a drive needs, as a CSV table.

Frames are decoded with a DBC. An MF4 file that holds signals instead of frames needs none. The user
assigns the signals, because their names differ between vehicles; the column name gives the unit.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import SPEED_COLUMNS_M_S
from iptm_core.routes.user_csv import MAX_TIME_GAP_S, PLACE_COLUMNS, ROAD_COLUMNS
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion

CAN_SUFFIXES = (".mf4", ".blf", ".asc")
CAN_COLUMNS = (*SPEED_COLUMNS_M_S, *PLACE_COLUMNS, *ROAD_COLUMNS)
STEP_S = 0.2
"""Between two rows of the table; signals are linear between their samples."""

_HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/can.txt"
_Samples = tuple[FloatArray, FloatArray]
"""Times in s and values of a signal."""


def can_log_csv(path: Path, dbc: Path | None, signals: Mapping[str, str]) -> str:
    """Return the drive in a log as the text of a CSV file that `read_user_trip` reads.

    Args:
        dbc: how its frames are decoded; None for an MF4 file that holds signals.
        signals: name of the signal of each column, one of `CAN_COLUMNS`; `MESSAGE.SIGNAL` where several
            messages have one of that name.
    """
    if path.suffix.lower() not in CAN_SUFFIXES:
        raise RouteError(f"{path}: allowed: a CAN log ({', '.join(CAN_SUFFIXES)})")
    unknown = [column for column in signals if column not in CAN_COLUMNS]
    if unknown or not signals:
        raise RouteError(
            f"columns are {', '.join(unknown) or 'none'}; allowed: {', '.join(CAN_COLUMNS)}"
        )
    wanted = set(signals.values())
    samples = _of_channels(path, wanted) if dbc is None else _of_frames(path, dbc, wanted)
    return _table(path, {column: samples[name] for column, name in signals.items()})


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise RouteError(
            f"CAN logs need {name}, which is not installed; install: {_HOW_TO}"
        ) from None


def _of_frames(path: Path, dbc: Path, wanted: Collection[str]) -> dict[str, _Samples]:
    """Return the wanted signals, decoded from the frames of a log."""
    can, cantools = _library("can"), _library("cantools")
    try:
        database = cantools.database.load_file(dbc)
    except Exception as reason:  # the readers have error types of their own
        raise RouteError(f"{dbc}: cannot be read as a DBC ({reason})") from reason
    sources = {name: _source(database, dbc, name) for name in wanted}
    messages = {
        (message.frame_id, message.is_extended_frame): message for message, _ in sources.values()
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in wanted}
    try:
        with can.LogReader(path) as log:
            for frame in log:
                message = messages.get((frame.arbitration_id, frame.is_extended_id))
                if message is None or frame.is_error_frame or frame.is_remote_frame:
                    continue
                try:
                    values = message.decode(bytes(frame.data), decode_choices=False)
                except (cantools.Error, ValueError):
                    continue  # cut short on the bus
                for name, (origin, signal) in sources.items():
                    if origin is message and signal in values:
                        found[name].append((float(frame.timestamp), float(values[signal])))
    except Exception as reason:
        raise RouteError(f"{path}: cannot be read as a CAN log ({reason})") from reason
    return {
        name: (np.array([at for at, _ in rows]), np.array([value for _, value in rows]))
        for name, rows in found.items()
    }


def _source(database: Any, dbc: Path, name: str) -> tuple[Any, str]:
    """Return the message and the name in it of a signal."""
    origin, _, signal = name.rpartition(".")
    known = [
        (message, entry.name)
        for message in database.messages
        for entry in message.signals
        if entry.name == signal and origin in {"", message.name}
    ]
    if len(known) == 1:
        return known[0]
    if known:
        several = ", ".join(f"{message.name}.{signal}" for message, _ in known)
        raise RouteError(f"{dbc}: signal {name!r} is in several messages; allowed: {several}")
    names = sorted({entry.name for message in database.messages for entry in message.signals})
    raise RouteError(f"{dbc}: no signal {name!r}; {suggestion(signal, names)}")


def _of_channels(path: Path, wanted: Collection[str]) -> dict[str, _Samples]:
    """Return the wanted channels of an MF4 file."""
    if path.suffix.lower() != ".mf4":
        raise RouteError(f"{path}: a log of frames; allowed: with a DBC that decodes them")
    asammdf = _library("asammdf")
    try:
        with asammdf.MDF(path) as log:
            known = sorted(log.channels_db)
            channels = {name: log.get(name) for name in wanted if name in log.channels_db}
            samples = {
                name: (channel.timestamps.astype(np.float64), channel.samples.astype(np.float64))
                for name, channel in channels.items()
            }
    except Exception as reason:
        raise RouteError(f"{path}: cannot be read as MF4 ({reason})") from reason
    missing = sorted(set(wanted) - set(samples))
    if missing:
        raise RouteError(f"{path}: no channel {missing[0]!r}; {suggestion(missing[0], known)}")
    return samples


def _table(path: Path, columns: Mapping[str, _Samples]) -> str:
    """Return the signals at common times."""
    clean: dict[str, _Samples] = {}
    for column, (raw_times, values) in columns.items():
        good = np.isfinite(raw_times) & np.isfinite(values)
        times, index = np.unique(raw_times[good], return_index=True)
        if times.size < 2:
            raise RouteError(f"{path}: {times.size} samples of {column}; allowed: 2 or more")
        gap_s = float(np.diff(times).max())
        if gap_s > MAX_TIME_GAP_S:
            raise RouteError(
                f"{path}: {column} is silent for {gap_s:g} s; allowed: up to {MAX_TIME_GAP_S:g} s"
            )
        clean[column] = (times, values[good][index])
    begin_s = max(float(times[0]) for times, _ in clean.values())
    end_s = min(float(times[-1]) for times, _ in clean.values())
    if end_s - begin_s < 2.0:
        raise RouteError(
            f"{path}: all signals together last {max(end_s - begin_s, 0.0):g} s; allowed: 2 s or more"
        )
    rows = STEP_S * np.arange(int((end_s - begin_s) / STEP_S + 1e-6) + 1)
    read = [np.interp(begin_s + rows, *samples) for samples in clean.values()]
    table = np.column_stack([rows, *read]).tolist()
    lines = (",".join(f"{value:.9f}".rstrip("0").rstrip(".") for value in row) for row in table)
    return "\n".join((",".join(("time_s", *clean)), *lines, ""))

"""Drives in logs of a vehicle's CAN bus: the signals that a drive needs, as a table and as CSV.

Frames are decoded with a DBC. An MF4 file that holds signals instead of frames needs none. The user
assigns the signals, because their names differ between vehicles; the column name gives the unit.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.can_files import CAN_SUFFIXES, frames_of, library
from iptm_core.routes.cleaning import clean
from iptm_core.routes.column_names import KNOWN_COLUMNS, Meaning, meaning_of, stated_unit
from iptm_core.routes.drive_table import DriveTable
from iptm_core.routes.text_table import REPAIRED
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion

CAN_COLUMNS: Mapping[str, Meaning] = {
    name: meaning for name in KNOWN_COLUMNS if name != "time_s" and (meaning := meaning_of(name))
}
STEP_S = 0.2
"""Between two rows of the CSV table; signals are linear between their samples."""

_Frames = list[tuple[int, Any]]
"""Numbers of frames in a log, and the frames."""


def can_log_csv(path: Path, dbc: Path | None, signals: Mapping[str, str], channel: str = "") -> str:
    """Return the drive in a log as the text of a CSV file that `read_user_trip` reads, see `read_can_log`."""
    drive = clean(read_can_log(path, dbc, signals, channel))
    times = drive.columns["time_s"]
    columns = {"time_s": STEP_S * np.arange(int(times[-1] / STEP_S + 1e-6) + 1)}
    for name in signals:
        meaning = CAN_COLUMNS[name]
        if meaning.quantity in drive.columns:
            values = meaning.from_si(drive.columns[meaning.quantity])
            columns[name] = np.interp(columns["time_s"], times, values)
    table = np.column_stack(list(columns.values())).tolist()
    lines = (",".join(f"{value:.9f}".rstrip("0").rstrip(".") for value in row) for row in table)
    notes = [f"{REPAIRED} {'; '.join(drive.notes)}"] if drive.notes else []
    return "\n".join((*notes, ",".join(columns), *lines, ""))


def read_can_log(
    path: Path, dbc: Path | None, signals: Mapping[str, str], channel: str = ""
) -> DriveTable:
    """Return the wanted signals of a log, one row for every frame.

    Args:
        dbc: how its frames are decoded; None for an MF4 file that holds signals.
        signals: name of the signal of each column, one of `CAN_COLUMNS`; `MESSAGE.SIGNAL` where several
            messages have one of that name, `CHANNEL@GROUP` where several groups have.
        channel: bus, or source address (0x..) of J1939, whose frames count; "" for the only one.
    """
    if Path(path.name.lower().removesuffix(".gz")).suffix not in CAN_SUFFIXES:
        raise RouteError(f"{path}: allowed: a CAN log ({', '.join(CAN_SUFFIXES)})")
    for file in filter(None, (path, dbc)):
        if not file.is_file():  # libraries would wait at a pipe
            raise RouteError(f"{file}: no such file; allowed: the path of an existing one")
    unknown = [column for column in signals if column not in CAN_COLUMNS]
    if unknown or not signals:
        raise RouteError(
            f"columns are {', '.join(unknown) or 'none'}; allowed: {', '.join(CAN_COLUMNS)}"
        )
    return _of_channels(path, signals) if dbc is None else _of_frames(path, dbc, signals, channel)


def _check_unit(where: object, column: str, signal: str, unit: str, notes: list[str]) -> None:
    """Refuse a signal whose stated unit is not the unit of its column."""
    quantity, stated = CAN_COLUMNS[column].quantity, stated_unit(CAN_COLUMNS[column].quantity, unit)
    if not stated:
        notes += [f"the unit of {signal} is {unit!r}: read as {column}"] if unit.strip() else []
        return
    same = {
        name: math.isclose(each.factor, Meaning(quantity, stated).factor, rel_tol=1e-6)
        for name, each in CAN_COLUMNS.items()
        if each.quantity == quantity
    }
    if not same[column]:
        hint = next((f"{name}={signal}" for name in same if same[name]), "signals in these units")
        raise RouteError(
            f"{where}: the unit of {signal} is {unit}, {column} is not; allowed: {hint}"
        )


def _of_frames(path: Path, dbc: Path, signals: Mapping[str, str], channel: str) -> DriveTable:
    cantools = library("cantools")
    try:
        # Overlapping signals of messages that are not asked for do no harm.
        database = cantools.database.load_file(dbc, strict=False)
    except Exception as reason:  # the readers have error types of their own
        raise RouteError(f"{dbc}: cannot be read as a DBC ({reason})") from reason
    notes: list[str] = []
    sources = {column: _source(database, dbc, name) for column, name in signals.items()}
    for column, (_, signal) in sources.items():
        _check_unit(dbc, column, signals[column], signal.unit or "", notes)
    messages = {message.frame_id: message for message, _ in sources.values()}
    found: dict[int, _Frames] = {number: [] for number in messages}
    number = 0
    for number, frame in enumerate(frames_of(path, notes), start=1):
        for wanted, message in messages.items():
            apart = frame.arbitration_id ^ wanted
            if frame.is_extended_id == message.is_extended_frame and not apart & _mask(message):
                found[wanted].append((number, frame))
    if not number:
        raise RouteError(
            f"{path}: 0 frames; allowed: a log with frames, in the format of its suffix"
        )
    rows: list[tuple[int, float, str, float]] = []
    for wanted, message in messages.items():
        own = {column: signal for column, (of, signal) in sources.items() if of is message}
        frames = _of_one_sender(path, message, found[wanted], channel, notes)
        rows += _decoded(f"{path}: {number} frames", message, frames, own, notes)
    numbers, index = np.unique([row[0] for row in rows], return_inverse=True)
    columns = {"time_s": np.full(numbers.size, np.nan)}
    for column in signals:
        columns[column] = np.full(numbers.size, np.nan)
    for place, (_, at_s, column, value) in zip(index.tolist(), rows, strict=True):
        columns["time_s"][place] = at_s
        columns[column][place] = value
    return _table(path, columns, numbers, "frame", notes)


def _mask(message: Any) -> int:
    """Return the bits of an identifier that name a message: without priority and addresses of J1939."""
    if not message.is_extended_frame:
        return 0x7FF
    return 0x03FFFF00 if (message.frame_id >> 16) & 0xFF >= 240 else 0x03FF0000


def _of_one_sender(
    path: Path, message: Any, frames: _Frames, channel: str, notes: list[str]
) -> _Frames:
    """Return the frames of a message from one bus, with the identifier of the DBC or else of one sender."""
    same = [each for each in frames if each[1].arbitration_id == message.frame_id]
    by_group = bool(frames and not same)
    senders = {f"0x{frame.arbitration_id & 0xFF:02X}" for _, frame in frames} if by_group else set()
    frames = same or frames

    def names(frame: Any) -> set[str]:
        return {str(frame.channel), f"0x{frame.arbitration_id & 0xFF:02X}"}

    labels = sorted({str(frame.channel) for _, frame in frames}) + sorted(senders)
    if channel:
        frames = [each for each in frames if channel in names(each[1])]
        if not frames:
            raise RouteError(
                f"{path}: {message.name} is not on {channel!r}; allowed: {', '.join(labels) or 'none'}"
            )
    left = {(str(frame.channel), frame.arbitration_id) for _, frame in frames}
    if len(left) > 1:
        raise RouteError(
            f"{path}: {message.name} is sent on or by {', '.join(labels)}; allowed: --channel with one"
        )
    if by_group:
        notes.append(f"{message.name} is from {', '.join(sorted(senders))}, by its PGN")
    return frames


def _decoded(
    where: str, message: Any, frames: _Frames, signals: Mapping[str, Any], notes: list[str]
) -> list[tuple[int, float, str, float]]:
    """Return number, time, column and value of the signals in frames; NaN outside of the range of the DBC."""
    rows: list[tuple[int, float, str, float]] = []
    beyond: Counter[str] = Counter()
    for number, frame in frames:
        try:
            values = message.decode(bytes(frame.data), decode_choices=False, allow_truncated=True)
        except Exception:  # noqa: BLE001, S112 - a multiplexer without this value
            continue
        for column, signal in signals.items():
            value = float(values.get(signal.name, math.nan))
            low, high = signal.minimum, signal.maximum
            if low is not None and high is not None and low < high and not low <= value <= high:
                beyond[column] += not math.isnan(value)
                value = math.nan
            if signal.name in values:
                rows.append((number, float(frame.timestamp), column, value))
    for column in signals:
        count = sum(row[2] == column and not math.isnan(row[3]) for row in rows)
        if count < 2:
            sizes = ", ".join(map(str, sorted({len(frame.data) for _, frame in frames}))) or "0"
            raise RouteError(
                f"{where}, {len(frames)} of them of {message.name} (0x{message.frame_id:X}, {sizes} bytes "
                f"long, in the DBC {message.length}), {beyond[column]} values outside of the range of the "
                f"DBC: {count} samples of {column}; allowed: 2 or more"
            )
        if beyond[column]:
            notes.append(
                f"{column} outside of the range of the DBC at {beyond[column]} frames: not measured"
            )
    return rows


def _table(
    path: Path, values: Mapping[str, FloatArray], numbers: Any, counted: str, notes: list[str]
) -> DriveTable:
    columns = {"time_s": values["time_s"] - np.nanmin(values["time_s"])}
    names = {}
    for column, meaning in CAN_COLUMNS.items():
        if column in values:
            columns[meaning.quantity] = meaning.in_si(values[column])
            names[meaning.quantity] = column, meaning.factor
    return DriveTable(str(path), columns, numbers, counted, names, sparse=True, notes=tuple(notes))


def _source(database: Any, dbc: Path, name: str) -> tuple[Any, Any]:
    """Return the message and the signal in it of a name."""
    origin, _, signal = name.rpartition(".")
    known = [
        (message, entry)
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


def _of_channels(path: Path, signals: Mapping[str, str]) -> DriveTable:
    """Return the wanted channels of an MF4 file."""
    if path.suffix.lower() != ".mf4":
        raise RouteError(f"{path}: a log of frames; allowed: with a DBC that decodes them")
    asammdf = library("asammdf")
    found: dict[str, Any] = {}
    try:
        with asammdf.MDF(path) as log:
            known = {name: list(places) for name, places in log.channels_db.items()}
            for column, name in signals.items():
                bare, _, group = name.partition("@")
                places = [place for place in known.get(bare, ()) if group in {"", str(place[0])}]
                if len(places) == 1:
                    found[column] = log.get(group=places[0][0], index=places[0][1])
    except Exception as reason:
        raise RouteError(f"{path}: cannot be read as MF4 ({reason})") from reason
    notes: list[str] = []
    for column, name in signals.items():
        bare = name.partition("@")[0]
        if column not in found and len(known.get(bare, ())) > 1:
            several = ", ".join(f"{bare}@{place[0]}" for place in known[bare])
            raise RouteError(f"{path}: channel {name!r} is in several groups; allowed: {several}")
        if column not in found:
            raise RouteError(f"{path}: no channel {name!r}; {suggestion(name, sorted(known))}")
        if found[column].samples.dtype.kind not in "biuf":
            raise RouteError(
                f"{path}: channel {name!r} holds no numbers; allowed: {column} as numbers"
            )
        _check_unit(path, column, name, found[column].unit or "", notes)
    ends = np.cumsum([0, *(each.timestamps.size for each in found.values())])
    times = np.concatenate([each.timestamps.astype(np.float64) for each in found.values()])
    order = np.argsort(times, kind="stable") if len(found) > 1 else np.arange(times.size)
    columns = {"time_s": times[order]}
    for begin, (column, each) in zip(ends.tolist(), found.items(), strict=False):
        values = np.full(times.size, np.nan)
        values[begin : begin + each.samples.size] = each.samples.astype(np.float64)
        columns[column] = values[order]
    return _table(path, columns, np.arange(1, times.size + 1), "sample", notes)

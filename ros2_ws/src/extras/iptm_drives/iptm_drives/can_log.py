"""Drives in logs of a vehicle's CAN bus: the signals that a drive needs, as a table and as CSV.

Frames are decoded with a DBC. An MF4 file that holds signals instead of frames needs none. The user
assigns the signals, because their names differ between vehicles; the column name gives the unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.state import FloatArray
from iptm_core.user_input import suggestion
from iptm_drives.can_files import CAN_SUFFIXES, MDF_SUFFIXES, frames_of, library
from iptm_drives.cleaning import clean
from iptm_drives.column_names import KNOWN_COLUMNS, Meaning, meaning_of, stated_unit
from iptm_drives.text_table import REPAIRED

if TYPE_CHECKING:
    import pandas as pd

CAN_COLUMNS: Mapping[str, Meaning] = {
    name: meaning for name in KNOWN_COLUMNS if name != "time_s" and (meaning := meaning_of(name))
}
STEP_S = 0.2
"""Between two rows of the CSV table; signals are linear between their samples."""

_FEWEST_TO_COMPARE, _MUCH_LESS = 20, 0.5
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
    quantity = CAN_COLUMNS[column].quantity
    stated = Meaning(quantity, stated_unit(quantity, unit))
    if not stated.unit:
        notes += [f"the unit of {signal} is {unit!r}: read as {column}"] if unit.strip() else []
        return
    columns = [name for name, each in CAN_COLUMNS.items() if each.quantity == quantity]
    same = [
        name
        for name in columns
        if math.isclose(CAN_COLUMNS[name].factor, stated.factor, rel_tol=1e-6)
    ]
    if column not in same:
        hint = f"{same[0]}={signal}" if same else f"signals for {', '.join(columns)}"
        raise RouteError(
            f"{where}: the unit of {signal} is {unit}, {column} is not; allowed: {hint}"
        )


def _of_frames(path: Path, dbc: Path, signals: Mapping[str, str], channel: str) -> DriveTable:
    import pandas as pd  # noqa: PLC0415  half a second of its own

    cantools = library("cantools")
    try:
        # Overlapping signals of messages that are not asked for do no harm.
        marked = dbc.read_bytes().startswith(b"\xef\xbb\xbf")
        encoding = "utf-8-sig" if marked else None
        database = cantools.database.load_file(dbc, strict=False, encoding=encoding)
    except Exception as reason:  # the readers have error types of their own
        raise RouteError(f"{dbc}: cannot be read as a DBC ({reason})") from reason
    notes: list[str] = []
    wanted: dict[Any, dict[str, Any]] = {}
    for column, name in signals.items():
        message, signal = _source(database, dbc, name)
        _check_unit(dbc, column, name, signal.unit or "", notes)
        wanted.setdefault(message, {})[column] = signal
    found: dict[Any, _Frames] = {message: [] for message in wanted}
    number = 0
    for number, frame in enumerate(frames_of(path, notes), start=1):
        for message in wanted:
            apart = frame.arbitration_id ^ message.frame_id
            if frame.is_extended_id == message.is_extended_frame and not apart & _mask(message):
                found[message].append((number, frame))
    if not number:
        raise RouteError(
            f"{path}: 0 frames; allowed: a log with frames, in the format of its suffix"
        )
    tables = []
    for message, own in wanted.items():
        frames = _of_one_sender(path, message, found[message], channel, notes)
        tables.append(_decoded(f"{path}: {number} frames", message, frames, own, notes))
    return _table(path, pd.concat(tables).sort_values("number", kind="stable"), "frame", notes)


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
) -> pd.DataFrame:
    """Return number, time and values of the frames; NaN outside of the range of the DBC."""
    import pandas as pd  # noqa: PLC0415  half a second of its own

    rows, decoded = [], []
    for number, frame in frames:
        with suppress(Exception):  # a multiplexer without this value, a frame that is too short
            decoded.append(
                message.decode(
                    bytes(frame.data), scaling=False, decode_choices=False, allow_truncated=True
                )
            )
            rows.append((number, float(frame.timestamp)))
    table = pd.DataFrame(rows, columns=["number", "time_s"])
    for column, signal in signals.items():
        raw = np.array([each.get(signal.name, math.nan) for each in decoded], np.float64)
        values = raw * signal.scale + signal.offset
        low, high = signal.minimum, signal.maximum
        has_range = low is not None and high is not None and low < high
        beyond = (values < low) | (values > high) if has_range else np.zeros(len(raw), np.bool_)
        table[column] = np.where(beyond, math.nan, values)
        lost, count = np.count_nonzero(beyond), table[column].count()
        if count < 2:
            sizes = ", ".join(map(str, sorted({len(frame.data) for _, frame in frames}))) or "0"
            raise RouteError(
                f"{where}, {len(frames)} of them of {message.name} (0x{message.frame_id:X}, {sizes} bytes "
                f"long, in the DBC {message.length}), {lost} values outside of the range of the DBC: "
                f"{count} samples of {column}; allowed: 2 or more"
            )
        if _is_of_other_byte_order(signal, raw[np.isfinite(raw)]):
            raise RouteError(
                f"{where}: {message.name}.{signal.name} leaps as {signal.byte_order}, and would go on evenly "
                "with its bytes in the other order; allowed: a DBC that has the order of the frames"
            )
        if lost:
            notes.append(f"{column} outside of the range of the DBC at {lost} frames: not measured")
    return table


def _is_of_other_byte_order(signal: Any, raw: FloatArray) -> bool:
    """Return whether the values of a signal change much less with the bytes of each in the other order."""
    if signal.length not in {16, 32, 64} or raw.size < _FEWEST_TO_COMPARE:
        return False
    kind = "f" if signal.is_float else "i" if signal.is_signed else "u"
    stated = raw.astype(f"{kind}{signal.length // 8}")
    # Ranks, because single values of another order may be as large as can be.
    ranks = [np.unique(each, return_inverse=True)[1] for each in (stated, stated.byteswap())]
    changes = [np.abs(np.diff(each)).sum() for each in ranks]
    return bool(changes[1] < _MUCH_LESS * changes[0])


def _table(path: Path, rows: pd.DataFrame, counted: str, notes: list[str]) -> DriveTable:
    columns = {"time_s": (rows["time_s"] - rows["time_s"].min()).to_numpy()}
    names = {}
    for column, meaning in CAN_COLUMNS.items():
        if column in rows:
            columns[meaning.quantity] = meaning.in_si(rows[column].to_numpy())
            names[meaning.quantity] = column, meaning.factor
    numbers = rows["number"].to_numpy()
    return DriveTable(str(path), columns, numbers, counted, names, sparse=True, notes=tuple(notes))


def _source(database: Any, dbc: Path, name: str) -> tuple[Any, Any]:
    """Return the message and the signal in it of a name."""
    origin, _, signal = name.rpartition(".")
    everything = [(message, entry) for message in database.messages for entry in message.signals]
    known = [pair for pair in everything if pair[1].name == signal]
    found = [pair for pair in known if origin in {"", pair[0].name}]
    if len(found) != 1:
        several = [f"{message.name}.{signal}" for message, _ in known]
        names = several or sorted({entry.name for _, entry in everything})
        raise RouteError(f"{dbc}: {len(found)} signals {name!r}; {suggestion(name, names)}")
    return found[0]


def _of_channels(path: Path, signals: Mapping[str, str]) -> DriveTable:
    """Return the wanted channels of an MF4 file."""
    if path.suffix.lower() not in MDF_SUFFIXES:
        raise RouteError(f"{path}: a log of frames; allowed: with a DBC that decodes them")
    import pandas as pd  # noqa: PLC0415  half a second of its own

    asammdf = library("asammdf")
    try:
        with asammdf.MDF(path) as log:
            found = {column: _channel(path, log, name) for column, name in signals.items()}
    except RouteError:
        raise
    except Exception as reason:
        raise RouteError(f"{path}: cannot be read as MDF ({reason})") from reason
    notes: list[str] = []
    tables = []
    for column, channel in found.items():
        _check_unit(path, column, signals[column], channel.unit or "", notes)
        if lost := int(np.count_nonzero(~np.isfinite(channel.samples))):
            notes.append(f"{column} not measured at {lost} samples")
        columns = {"time_s": channel.timestamps, column: channel.samples}
        tables.append(pd.DataFrame(columns, dtype=np.float64))
    rows = pd.concat(tables)
    rows = rows.sort_values("time_s", kind="stable") if len(tables) > 1 else rows
    rows["number"] = np.arange(1, len(rows) + 1)
    return _table(path, rows, "sample", notes)


def _channel(path: Path, log: Any, name: str) -> Any:
    """Return the only channel of a name, with or without its group, in an MF4 file."""
    bare, _, group = name.partition("@")
    several = [f"{bare}@{place[0]}" for place in log.channels_db.get(bare, ())]
    places = [place for place in log.channels_db.get(bare, ()) if group in {"", str(place[0])}]
    if len(places) != 1:
        names = several or sorted(log.channels_db)
        raise RouteError(f"{path}: {len(places)} channels {name!r}; {suggestion(name, names)}")
    channel = log.get(group=places[0][0], index=places[0][1])
    if channel.samples.dtype.kind not in "biuf":
        raise RouteError(f"{path}: channel {name!r} holds no numbers; allowed: one that does")
    return channel

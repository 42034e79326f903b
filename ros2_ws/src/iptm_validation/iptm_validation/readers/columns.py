"""Columns of text files: compact CSV through Arrow, downloaded CSV with whatever surrounds its header."""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, cast

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from iptm_core.errors import MeasurementError
from iptm_core.state import FloatArray

HEAD_LINES = 12


@contextmanager
def _text(path: Path) -> Iterator[IO[str]]:
    """Open plain or compressed text; the degree sign of the originals is Latin-1 or UTF-8."""
    with _binary(path) as stream:
        head = stream.read(20000)
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8-sig")
        encoding = "utf-8-sig"
    except UnicodeDecodeError:
        encoding = "latin-1"
    with _binary(path) as stream:
        yield io.TextIOWrapper(stream, encoding=encoding, newline="")


def _binary(path: Path) -> IO[bytes]:
    return cast("IO[bytes]", gzip.open(path)) if path.suffix == ".gz" else path.open("rb")


def head_of(path: Path) -> list[str]:
    """Return the first lines of a text file."""
    with _text(path) as text:
        return [line.rstrip("\r\n") for _, line in zip(range(HEAD_LINES), text, strict=False)]


def compact_columns(path: Path, needed: tuple[str, ...]) -> dict[str, list[str] | FloatArray]:
    """Read the needed columns of a compact file; text stays text, numbers are floats with NaN.

    Raises:
        MeasurementError: a column is missing or the file is malformed.
    """
    try:
        table = arrow_csv.read_csv(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise MeasurementError(f"{path.name} is not readable: {error}") from error
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise MeasurementError(f"{path.name} lacks the columns {', '.join(missing)}")
    found: dict[str, list[str] | FloatArray] = {}
    for name in needed:
        column = table[name]
        if pa.types.is_string(column.type):
            found[name] = column.to_pylist()
        else:
            found[name] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    return found


def texts(columns: dict[str, list[str] | FloatArray], name: str) -> list[str]:
    """Return a column of text."""
    column = columns[name]
    return [str(value) for value in column]


def numbers(columns: dict[str, list[str] | FloatArray], name: str) -> FloatArray:
    """Return a column of numbers; one without any value is all NaN.

    Raises:
        MeasurementError: the column holds text.
    """
    column = columns[name]
    try:
        return np.array([np.nan if v in {"", None} else v for v in column], dtype=np.float64)
    except ValueError as error:
        raise MeasurementError(f"column {name} is not numeric: {error}") from error


def original_rows(path: Path, delimiter: str, skip: int) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a downloaded CSV file behind ``skip`` leading lines."""
    with _text(path) as text:
        reader = csv.reader(text, delimiter=delimiter)
        for _ in range(skip):
            next(reader, None)
        header = [cell.strip() for cell in next(reader, [])]
        return header, [row for row in reader if row]


def cell_number(text: str) -> float:
    """Return the number in a cell, NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def original_column(rows: list[list[str]], index: int) -> FloatArray:
    """Return one column of rows as numbers, NaN where a cell is empty or missing."""
    return np.array(
        [cell_number(row[index]) if index < len(row) else np.nan for row in rows], dtype=np.float64
    )


def block_means(values: FloatArray, size: int) -> FloatArray:
    """Return the means of blocks of rows, without the NaN in them; shape (ceil(n / size),)."""
    blocks = -(-len(values) // size)
    padded = np.full(blocks * size, np.nan)
    padded[: len(values)] = values
    grid = padded.reshape(blocks, size)
    known = np.isfinite(grid)
    count = known.sum(axis=1)
    total = np.where(known, grid, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)

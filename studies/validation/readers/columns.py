"""Columns of text files, compact or as downloaded with whatever surrounds their header."""

from __future__ import annotations

import gzip
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from iptm.parts import FloatArray, MeasurementError

HEAD_LINES = 12
_HEAD_BYTES = 20000


def _encoding(path: Path) -> str:
    """Return the encoding of a file; the degree sign of the originals is Latin-1 or UTF-8."""
    head = _head_bytes(path)
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8-sig")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _head_bytes(path: Path) -> bytes:
    opened = gzip.open if path.suffix == ".gz" else open
    with opened(path, "rb") as stream:
        head: bytes = stream.read(_HEAD_BYTES)
    return head


def head_of(path: Path) -> list[str]:
    """Return the first lines of a text file."""
    lines = _head_bytes(path).decode(_encoding(path), errors="ignore").splitlines()
    return lines[:HEAD_LINES]


def compact_table(path: Path, needed: tuple[str, ...]) -> pd.DataFrame:
    """Read the needed columns of a compact file.

    Raises:
        MeasurementError: a column is missing or the file is malformed.
    """
    try:
        table = pd.read_csv(path, float_precision="round_trip")
    except (ValueError, OSError, EOFError) as error:
        raise MeasurementError(f"{path.name} is not readable: {error}") from error
    _check_columns(path, table, needed)
    return table[list(needed)]


def _check_columns(path: Path, table: pd.DataFrame, needed: Iterable[str]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise MeasurementError(f"{path.name} lacks the columns {', '.join(missing)}")


def original_table(
    path: Path, needed: Iterable[str], delimiter: str = ",", skip: int = 0
) -> pd.DataFrame:
    """Return the texts of a downloaded CSV file behind ``skip`` leading lines; missing values are empty.

    Raises:
        MeasurementError: a needed column is missing.
    """
    table = pd.read_csv(
        path,
        sep=delimiter,
        skiprows=skip,
        encoding=_encoding(path),
        dtype=str,
        keep_default_na=False,
        index_col=False,
    )
    table = table.rename(columns=str.strip)
    _check_columns(path, table, needed)
    return table


def numbers(column: pd.Series) -> FloatArray:
    """Return a column as numbers, NaN where a cell holds none."""
    return np.array(pd.to_numeric(column, errors="coerce"), dtype=np.float64)


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

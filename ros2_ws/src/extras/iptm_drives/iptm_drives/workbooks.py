"""Workbooks and data frames: xlsx with openpyxl, Feather with pandas and pyarrow."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib import import_module
from typing import Any


def xlsx(content: bytes) -> str:
    """Return the sheet with the most rows as the text of a table."""
    book = import_module("openpyxl").load_workbook(
        io.BytesIO(content), read_only=True, data_only=True
    )
    sheets: list[list[tuple[Any, ...]]] = [
        [row for row in sheet.iter_rows(values_only=True) if any(cell is not None for cell in row)]
        for sheet in book.worksheets
    ]
    text = io.StringIO()
    longest = max(sheets, key=len, default=[])
    csv.writer(text).writerows(map(_cells, longest))
    return text.getvalue()


def _cells(row: tuple[Any, ...]) -> list[str]:
    texts = ("" if cell is None else cell for cell in row)
    return [cell.isoformat() if hasattr(cell, "isoformat") else str(cell) for cell in texts]


def feather(content: bytes) -> Mapping[str, Any]:
    """Return the columns of an Arrow file."""
    import pandas as pd  # noqa: PLC0415  a second of its own

    import_module("pyarrow")
    frame = pd.read_feather(io.BytesIO(content))
    return {str(name): frame[name].to_numpy() for name in frame}

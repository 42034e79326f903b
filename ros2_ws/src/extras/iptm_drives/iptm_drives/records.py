"""Records in JSON: a list of them, one per line, or a list inside a document as in Google's Takeout."""

from __future__ import annotations

import json
from typing import Any

from iptm_drives.receivers import Columns, columns_of_rows


def records(content: bytes) -> Columns:
    """Return the plain values of records by name; a value that a record lacks is empty."""
    text = content.decode("utf-8-sig")
    try:
        document = json.loads(text)
    except json.JSONDecodeError:
        document = [json.loads(line) for line in text.splitlines() if line.strip()]
    found = [each for each in _listed(document) if isinstance(each, dict)]
    names = list(dict.fromkeys(name for each in found for name in each))
    rows = [[_plain(each.get(name)) for name in names] for each in found]
    return columns_of_rows(names, rows)


def _listed(document: Any) -> list[Any]:
    """Return the document if it is a list, else the longest list in it."""
    if isinstance(document, dict):
        lists = [each for each in document.values() if isinstance(each, list)]
        return max(lists, key=len, default=[])
    return document if isinstance(document, list) else []


def _plain(value: Any) -> str:
    return "" if value is None or isinstance(value, (dict, list)) else str(value)

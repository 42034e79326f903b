"""XML of users, with nothing but the standard library, and without what makes XML dangerous."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.strict_mapping import shown
from iptm_core.user_input import number, read_bounded


class PlainXml:
    """Base of what takes the elements of a file; see `xml.etree.ElementTree.XMLParser`.

    It refuses document types, and with them entities that blow up or read other files.
    """

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:  # noqa: ARG002
        """Refuse; the parser calls this before it reads any entity."""
        raise RouteError(f"document type {name!r}; allowed: none, no drive needs one")


class _Tree(PlainXml, ET.TreeBuilder):
    """Builds the whole tree."""


def read_xml(path: Path, most_bytes: int, kind: str, target: PlainXml | None = None) -> Any:
    """Read a file.

    Args:
        path: the file.
        most_bytes: largest size that is read.
        kind: what it should be, for messages.
        target: takes the elements; None builds a tree of them.

    Returns:
        What the target's ``close`` returns: of a tree its root.

    Raises:
        RouteError: no such file, no XML, too large, or a document type.
    """
    try:
        content = read_bounded(path, most_bytes)
        parser = ET.XMLParser(target=target or _Tree())  # noqa: S314 - entities are refused
        return ET.fromstring(content, parser)  # noqa: S314
    except FileNotFoundError:
        raise RouteError(
            f"{path}: no such file; give the path of an existing {kind} file"
        ) from None
    except RouteError as reason:
        raise RouteError(f"{path}: {reason}") from None
    except (OSError, ValueError, LookupError, ET.ParseError) as reason:
        raise RouteError(f"{path}: cannot be read ({reason}); a {kind} file is needed") from reason


def finite_number(where: str, name: str, text: str | None) -> float:
    """Read an attribute or the text of an element.

    Raises:
        RouteError: it is missing, or no finite number.
    """
    try:
        value = number(text or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise RouteError(f"{where}: {name} is {shown(text)}; allowed: a finite number")
    return value

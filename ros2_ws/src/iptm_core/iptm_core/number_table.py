"""The numbers of generated C in one table.

Generated C holds the numbers of a model as hundreds of literals, and to compile it takes seconds. Read from
a table instead, they are data at one place of the library, behind a mark that occurs nowhere else; for
another model the library is copied with other numbers there. The table is constant, but its content is
unknown while the code is compiled: the same operations are done on the same numbers as with literals, bit by
bit.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Sequence

_NAME = "iptm_numbers"
_TOKEN = re.compile(
    # The set in front lets the search leap to what may be a token.
    r"[s\d](?:"
    # Arrays of constants need literals; they stay what they are.
    r"(?<=s)tatic const casadi_\w+ [^;]*;"
    r"|(?<=[^\w.]\d)(?:\d*\.\d*(?:[eE][-+]?\d+)?|\d*[eE][-+]?\d+)(?![\w.]))"
)
_LITERAL = frozenset({0.0, 0.5, 1.0, 2.0})
"""Numbers for which compilers simplify operations."""
_MARK_NUMBERS = (3.1662e-287, -7.29318e193, 4.4251e118, -9.87203e-61)
_MARK = struct.pack("<4d", *_MARK_NUMBERS)
"""Begins the table."""
_ELF = b"\x7fELF"
_HIDDEN = '__attribute__((visibility("hidden")))'


def split_numbers(
    source: str, name: str = _NAME, first: int = len(_MARK_NUMBERS)
) -> tuple[str, tuple[float, ...]]:
    """Return generated C that reads its numbers from a table, and the table by first appearance.

    Args:
        name: of the table in the code.
        first: place of the first number in it.
    """
    places: dict[float, int] = {}

    def entry(found: re.Match[str]) -> str:
        if found[0].startswith("s"):
            return found[0]
        number = float(found[0])
        if number in _LITERAL:
            return found[0]
        return f"{name}[{places.setdefault(number, len(places)) + first}]"

    text = _TOKEN.sub(entry, source)
    return text, tuple(places)


def table_declaration() -> str:
    """Return the C declaration of the table, for files that read from it."""
    return f"extern const double {_NAME}[] {_HIDDEN};\n"


def table_source(numbers: Sequence[float]) -> str:
    """Return the C source of the table; compiled separately, as the only place of the numbers."""
    values = ", ".join(number.hex() for number in (*_MARK_NUMBERS, *numbers))
    return f"const double {_NAME}[] {_HIDDEN} = {{{values}}};\n"


def with_numbers(library: bytes, numbers: Sequence[float]) -> bytes | None:
    """Return a library with other numbers in its table; None where the table is not found."""
    start = library.find(_MARK) + len(_MARK)
    # Elsewhere a file that was changed may not be loaded (code signatures).
    if (
        not library.startswith(_ELF)
        or library.count(_MARK) != 1
        or start + 8 * len(numbers) > len(library)
    ):
        return None
    table = struct.pack(f"<{len(numbers)}d", *numbers)
    return library[:start] + table + library[start + len(table) :]


def numbers_key(numbers: Sequence[float]) -> str:
    """Return what stands behind the key of the code; nothing where the code has no numbers."""
    if not numbers:
        return ""
    digest = hashlib.sha256(struct.pack(f"<{len(numbers)}d", *numbers)).hexdigest()
    return f"_{digest[:24]}"

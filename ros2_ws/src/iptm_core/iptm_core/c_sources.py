"""Hand-written C files of a package, with headers of the constants that they have from Python modules.

A number is declared in Python alone. A C file that includes ``NAME_constants.h`` uses it under the same name,
a header (``*.h``) with the prefix ``IPTM_``; a leading underscore is dropped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

_INCLUDED = re.compile(r'^#include "(\w+)_constants\.h"$', re.MULTILINE)
_CAPITALS = re.compile(r"\b[A-Z][A-Z0-9_]+\b")
_PREFIX = "IPTM_"


@dataclass(frozen=True)
class CSources:
    """A folder of C files.

    Attributes:
        folder: where they are.
        modules: names of the Python modules that have the constants of ``NAME_constants.h``, by NAME.
    """

    folder: Path
    modules: Mapping[str, tuple[str, ...]]

    def read(self, *names: str) -> dict[str, str]:
        """Return files by name, and the headers of constants that they include."""
        files = {name: (self.folder / name).read_text("ascii") for name in names}
        headers = {
            f"{unit}_constants.h": self._header(unit, text, _PREFIX if name.endswith(".h") else "")
            for name, text in files.items()
            for unit in _INCLUDED.findall(text)
        }
        return files | headers

    def _header(self, unit: str, text: str, prefix: str) -> str:
        used = {name.removeprefix(prefix) for name in _CAPITALS.findall(text) if prefix in name}
        constants = self._constants(unit)
        lines = [
            f"#define {prefix}{name} {_literal(constants[name])}"
            for name in sorted(used & constants.keys())
        ]
        return "\n".join([f"/* Of {', '.join(self.modules[unit])}. */", *lines, ""])

    def _constants(self, unit: str) -> Mapping[str, float]:
        found: dict[str, float] = {}
        for module in self.modules[unit]:
            for name, value in _numbers(vars(import_module(module)).items()):
                if found.setdefault(name, value) != value:
                    raise AssertionError(f"{name} has two values in {self.modules[unit]}")
        return found


def _numbers(members: Iterable[tuple[str, object]]) -> Iterable[tuple[str, float]]:
    for name, value in members:
        constant = name.lstrip("_")
        if isinstance(value, (int, float)) and _CAPITALS.fullmatch(constant):
            yield constant, value


def _literal(value: float) -> str:
    return repr(value) if value >= 0 else f"({value!r})"

"""Which topics to take: names and shell patterns, on the way into a bag and out of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class TopicSelection:
    """Topics wanted and not wanted.

    Attributes:
        include: full names or patterns (``/plant/*``, where ``*`` also spans ``/``); empty for all.
        exclude: full names or patterns that are left out in any case.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()

    def takes(self, name: str) -> bool:
        """Tell whether a topic is wanted.

        Args:
            name: fully qualified name.
        """
        if any(matches(name, pattern) for pattern in self.exclude):
            return False
        return not self.include or any(matches(name, pattern) for pattern in self.include)

    def unused(self, names: Iterable[str]) -> list[str]:
        """Return the patterns, wanted or not, that none of the names matches (typing errors)."""
        known = list(names)
        return [
            pattern
            for pattern in (*self.include, *self.exclude)
            if not any(matches(name, pattern) for name in known)
        ]


def matches(name: str, pattern: str) -> bool:
    """Compare a topic name with a pattern; a relative pattern matches in any namespace."""
    if pattern.startswith("/"):
        return fnmatchcase(name, pattern)
    return fnmatchcase(name, f"/{pattern}") or fnmatchcase(name, f"*/{pattern}")

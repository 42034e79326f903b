"""Enumerations of words, as they are written in files, on command lines and in diagnostics.

What ``enum.StrEnum`` is from Python 3.11 on.
"""

from __future__ import annotations

from enum import Enum


class TextEnum(str, Enum):
    """Members are their words, in texts, too."""

    def __str__(self) -> str:
        """Return the bare word."""
        return str(self.value)

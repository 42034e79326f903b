"""Where a parameter value comes from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class SourceTag(str, Enum):
    """How much a value can be trusted, and by whom it was stated."""

    PAPER = "paper"
    DERIVED = "derived"
    PUBLISHED = "published"
    CHOSEN = "chosen"
    OVERRIDE = "override"

    def __str__(self) -> str:
        """Return the bare word, as it is written in a file."""
        return str(self.value)


#: Tags that a parameter file may use; an override is tagged by the loader.
FILE_TAGS = (SourceTag.PAPER, SourceTag.DERIVED, SourceTag.PUBLISHED, SourceTag.CHOSEN)


@dataclass(frozen=True)
class Source:
    """One value as it was written.

    Attributes:
        value: the number as written, in ``unit`` (for a table: as interpolated, in the unit written).
        unit: the unit it was written in, which may differ from the unit of the model (degC, km/h).
        tag: where it comes from.
        note: remark of the file, may be empty.
    """

    value: float
    unit: str
    tag: SourceTag
    note: str = ""

"""The report as data: sections of paragraphs, tables, figures and checked statements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from iptm_reproduction.check import CheckedClaim, Verdict


@dataclass(frozen=True)
class Cell:
    """One cell of a table.

    Attributes:
        text: content.
        verdict: how it compares with the printed number; None where nothing is compared.
        strong: whether it is set off.
    """

    text: str
    verdict: Verdict | None = None
    strong: bool = False


Row = tuple[Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        key: identifier, anchor in the page.
        title: heading.
        head: column heads.
        rows: cells, as many per row as there are heads.
        note: remark under the table.
        paper: where it stands in the paper; empty for one beyond it.
    """

    key: str
    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""
    paper: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"table {self.key}: {len(row)} cells under {len(self.head)} heads")


@dataclass(frozen=True)
class Picture:
    """A figure.

    Attributes:
        key: identifier, file name without suffix.
        title: heading.
        caption: what is shown.
        png: content of the file.
        paper: which figure of the paper it stands for, and its caption; empty for one beyond it.
    """

    key: str
    title: str
    caption: str
    png: bytes = field(repr=False)
    paper: str = ""


@dataclass(frozen=True)
class Paragraph:
    """Plain text."""

    text: str


@dataclass(frozen=True)
class Missing:
    """A table or figure that cannot be made, and why.

    Attributes:
        key: identifier of what is missing.
        title: its heading.
        reason: which runs are missing.
        command: what computes them.
    """

    key: str
    title: str
    reason: str
    command: str


@dataclass(frozen=True)
class ClaimList:
    """Checked statements."""

    entries: tuple[CheckedClaim, ...]


Block = Table | Picture | Paragraph | Missing | ClaimList


@dataclass(frozen=True)
class Section:
    """A chapter of the report."""

    key: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Document:
    """The whole report.

    Attributes:
        title: heading.
        subtitle: what is reproduced.
        sections: chapters in order.
    """

    title: str
    subtitle: str
    sections: tuple[Section, ...]

    def blocks(self) -> Iterator[Block]:
        """Return all blocks in order."""
        return (block for section in self.sections for block in section.blocks)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures."""
        return tuple(block for block in self.blocks() if isinstance(block, Picture))


def cells(*texts: str) -> Row:
    """Return a row of plain cells."""
    return tuple(Cell(text) for text in texts)

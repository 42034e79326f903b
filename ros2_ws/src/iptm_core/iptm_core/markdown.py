"""Tables in Markdown, for the pages that programs of the suite write."""

from __future__ import annotations

from collections.abc import Iterable


def markdown_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table without a line end behind its last row.

    Args:
        heads: headings; a colon at the end aligns the column to the right and is not shown.
    """
    heads = list(heads)
    lines = [
        f"| {' | '.join(head.removesuffix(':') for head in heads)} |",
        f"|{'|'.join('---:' if head.endswith(':') else '---' for head in heads)}|",
    ]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])

"""Pages in Markdown: templates of prose in package data, and tables of records."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from string import Formatter
from typing import Any

import jinja2

NO_VALUE = "–"
_NEGATIVE_ZERO = re.compile(r"(?<![\w.])-(0(?:\.0+)?)(?![\w.])")


def markdown_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table without a final line end; a heading with a colon at its end aligns to the right."""
    heads = list(heads)
    lines = [
        f"| {' | '.join(head.removesuffix(':') for head in heads)} |",
        f"|{'|'.join('---:' if head.endswith(':') else '---' for head in heads)}|",
    ]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])


def table_of(
    records: Any,
    columns: Mapping[str, str] | Iterable[tuple[str, str]],
    numbers: Iterable[str] = (),
) -> str:
    """Return records as a table.

    Args:
        records: a pandas DataFrame, or mappings of values by name.
        columns: heading (as in `markdown_table`) and format of the cells, as ``{"gap, m:": "{gap_m:.1f}"}``.
            A cell of which a value is missing (None or NaN) shows `NO_VALUE`, and zero has no sign but with
            a format that asks for one (``+``).
        numbers: further columns under their own names, aligned to the right.
    """
    pairs = list(columns.items() if isinstance(columns, Mapping) else columns)
    pairs += [(f"{name}:", f"{{{name}}}") for name in numbers]
    return markdown_table((head for head, _ in pairs), cells_of(records, pairs))


def cells_of(
    records: Any, columns: Mapping[str, str] | Iterable[tuple[str, str]]
) -> Iterator[list[str]]:
    """Yield the cells of each row of a table, see `table_of`."""
    if hasattr(records, "to_dict"):
        records = records.to_dict("records")
    formats = columns.values() if isinstance(columns, Mapping) else [text for _, text in columns]
    return ([_cell(text, record) for text in formats] for record in records)


def _cell(text: str, record: Mapping[str, Any]) -> str:
    names = [re.split(r"[.\[]", name)[0] for _, name, _, _ in Formatter().parse(text) if name]
    values = (record[name] for name in names)
    if any(value is None or value != value for value in values):  # noqa: PLR0124  # NaN
        return NO_VALUE
    shown = text.format_map(record)
    return shown if "+" in text else _NEGATIVE_ZERO.sub(r"\1", shown)


def render_page(package: str | Path, template: str, **values: Any) -> str:
    """Return a page from a Jinja template; an undefined name is an error.

    A template has `table` (see `table_of`) as a filter: ``{{ rows | table({"gap, m:": "{gap_m:.1f}"}) }}``.

    Args:
        package: package or folder that contains the template.
    """
    loader: jinja2.BaseLoader
    if isinstance(package, Path):
        loader = jinja2.FileSystemLoader(package)
    else:
        loader = jinja2.PackageLoader(package, ".")
    pages = jinja2.Environment(  # noqa: S701  # Markdown, not HTML
        loader=loader,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    pages.filters["table"] = table_of
    return pages.get_template(template).render(values)

"""The page from a store: the parts of ``page.yaml``, as one HTML file and as Markdown with figures."""

from __future__ import annotations

import base64
import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
import yaml
from markupsafe import Markup, escape

from iptm.studies.campaign import Campaign
from iptm.studies.store import ResultStore
from iptm_core.errors import StoreError
from iptm_reproduction import (
    aging,
    names,
    paper_tables,
    printed,
    tables,
)
from iptm_reproduction.claims import claims_by_topic, evaluated, number_texts, rendered
from iptm_reproduction.identification import spread, unknowns
from iptm_reproduction.names import expanded, studies_of
from iptm_reproduction.plots import drawn
from iptm_reproduction.printed import PAPER, Verdict
from iptm_reproduction.results import Results, gather
from iptm_reproduction.tables import strong

NAME = "paper-reproduction"
"""Name of the pages, and of the folder of their figures."""
_HERE = Path(__file__).parent
_PAGE: dict[str, Any] = yaml.safe_load((_HERE / "page.yaml").read_text(encoding="utf-8"))
_HEAD = {
    "title": _PAGE["title"],
    "subtitle": PAPER,
    "legend": "Marks: " + ", ".join(f"{verdict.symbol} {verdict.value}" for verdict in Verdict),
}


@dataclass(frozen=True)
class Block:
    """A part of a chapter.

    Attributes:
        kind: text, table, picture, claims, or missing for a table or picture whose runs are not there.
        key: identifier of a table or picture: anchor, and file name without suffix.
        title: heading of a table or picture.
        paper: where it stands in the paper; empty for one beyond it.
        text: the text, the note under a table, the caption of a picture, or which runs are missing and why.
        content: rows of a table, PNG file of a picture, or pairs of statement and finding.
        command: what computes the missing runs.
    """

    kind: str
    key: str = ""
    title: str = ""
    paper: str = ""
    text: str = ""
    content: Any = field(default=None, repr=False)
    command: str = ""


Chapters = Mapping[tuple[str, str], tuple[Block, ...]]
"""The page: the blocks of its chapters in order, by key and title."""


def blocks_of(chapters: Chapters, *kinds: str) -> Iterator[Block]:
    """Return the blocks of some kinds, in order."""
    return (block for block in itertools.chain(*chapters.values()) if block.kind in kinds)


def build_report(store: ResultStore, campaign: Campaign, output_dir: Path) -> tuple[Path, ...]:
    """Write the report from what is stored, and return its pages; nothing is computed.

    The pages are ``paper-reproduction.html``, one file with everything inside, and ``paper-reproduction.md``
    with a folder of figures. The campaign was compared with the store (``campaign.survey``); missing runs
    leave notes.

    Raises:
        ScenarioError: not a single run is there.
        StoreError: a run cannot be read, or the folder cannot be written.
    """
    return write_report(compose(gather(store, campaign)), output_dir)


def write_report(chapters: Chapters, output_dir: Path) -> tuple[Path, ...]:
    """Write the figures and the pages, and return the latter; figures of an older report are removed.

    Raises:
        StoreError: the folder cannot be written.
    """
    folder = output_dir / NAME
    pages = {
        output_dir / f"{NAME}.html": render_html(chapters).encode(),
        output_dir / f"{NAME}.md": render_markdown(chapters, NAME).encode(),
    }
    figures = {
        folder / f"{block.key}.png": block.content for block in blocks_of(chapters, "picture")
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in set(folder.glob("*.png")) - set(figures):
            old.unlink()
        for path, content in {**pages, **figures}.items():
            path.write_bytes(content)
    except OSError as error:
        raise StoreError(f"report cannot be written to {output_dir}: {error}") from error
    return tuple(pages)


def compose(results: Results) -> Chapters:
    """Check every statement and put the page together; parts that cannot be built state the reason."""
    page = _Page(results)
    return {
        (chapter["key"], chapter["title"]): tuple(
            block for part in chapter["parts"] if (block := page.block(part)) is not None
        )
        for chapter in _PAGE["chapters"]
    }


_MODULES = (
    aging,
    names,
    paper_tables,
    printed,
    spread,
    tables,
    unknowns,
)
_PUBLIC = {
    name: entry
    for module in _MODULES
    for name, entry in vars(module).items()
    if not name.startswith("_")
}
"""What templates of the page can name."""


class _Page:
    """Builds parts from what was gathered."""

    def __init__(self, results: Results) -> None:
        self._results = results
        self._checked = {
            topic: [(claim, claim.check(results)) for claim in claims]
            for topic, claims in claims_by_topic().items()
        }
        self._context = {
            **_PUBLIC,
            **number_texts(self._results),
            "verdicts": self._verdicts(),
            "origin": results.origin,
            "command": results.command,
        }

    def _verdicts(self) -> dict[str, list[str]]:
        """Return the verdicts on the statements of each topic, and on all of them."""
        found = {
            topic: [finding.verdict.value for _, finding in entries]
            for topic, entries in self._checked.items()
        }
        return found | {strong("all statements"): list(itertools.chain(*found.values()))}

    def block(self, part: Mapping[str, Any]) -> Block | None:
        """Return a part; None for a text that is empty."""
        kind, key = next(iter(part.items()))
        if kind == "text":
            text = self._text(key)
            return Block(kind, text=text) if text else None
        if kind == "claims":
            return Block(kind, content=self._checked[key])
        lacking = self._results.lacking(_runs(part, "needs"))
        any_of = _runs(part, "any_of")
        if any_of and self._results.lacking(any_of) == any_of:
            lacking = (*lacking, *any_of)
        if lacking:
            return Block(
                "missing",
                key,
                part["title"],
                text=self._results.missing_text(lacking),
                command=f"{self._results.command} {' '.join(studies_of(lacking))}",
            )
        text = self._text(part.get("note") or part.get("caption", ""))
        if kind == "table":
            content: Any = self._table(key, part)
        else:
            content = drawn(key, self._results)
            left_out = self._results.lacking(_runs(part, "wanted"))
            text += f" Left out: {self._results.missing_text(left_out)}." if left_out else ""
        return Block(kind, key, part["title"], part.get("paper", ""), text, content)

    def _text(self, template: str, **more: Any) -> str:
        return rendered(template, **self._context, **more)

    def _table(self, key: str, part: Mapping[str, Any]) -> pd.DataFrame:
        if "each" in part or "cells" in part:
            return self._listed(part)
        if "columns" in part:
            keys = ("runs", "columns", "base", "without", "needs_base")
            given = {key: part[key] for key in keys if key in part}
            return tables.run_table(self._results, **given)
        name = part.get("rows", key.replace("-", "_"))
        build = getattr(paper_tables, name, None) or getattr(tables, name)
        return build(self._results, **part.get("with", {}))

    def _listed(self, part: Mapping[str, Any]) -> pd.DataFrame:
        """Return a row for each of several things, by a template for each column, and rows of single cells.

        Things with a ``name`` are the columns instead.
        """
        columns = part.get("columns", {})
        things = list(evaluated(part.get("each", "[]"), **self._context))
        rows = [
            [self._text(cell, row=thing, index=index) for cell in columns.values()]
            for index, thing in enumerate(things)
        ]
        rows += [[self._text(cell) for cell in row] for row in part.get("cells", ())]
        table = tables.table_of(part.get("heads", list(columns)), rows)
        if "name" in part:
            table.index = [self._text(part["name"], row=thing) for thing in things]
            table = table.T.rename_axis("").reset_index()
        return table


def _runs(part: Mapping[str, Any], name: str) -> tuple[str, ...]:
    given = part.get(name, ())
    return expanded(*([given] if isinstance(given, str) else given))


_NUMBER = re.compile(r"[+\-−]?[\d. ]+(?: %)?(?: \(.*\))?|–")
_MARKED = re.compile(
    rf"(.*) ([{''.join(verdict.symbol for verdict in Verdict if verdict.symbol != '–')}])"
)
_STRONG = re.compile(r"\*\*(.*)\*\*")
_RUNS = "|-"
"""First characters of lines that form one block: table rows and list entries."""


def render_html(chapters: Chapters) -> str:
    """Return the page; figures are embedded, so that the one file is all."""
    template = _environment(escapes=True).get_template("report.html.j2")
    return template.render(chapters=chapters, **_HEAD)


def render_markdown(chapters: Chapters, folder: str) -> str:
    """Return the page as Markdown; its figures lie in a folder relative to the file."""
    template = _environment(escapes=False).get_template("report.md.j2")
    return spaced(template.render(folder=folder, chapters=chapters, **_HEAD))


def spaced(text: str) -> str:
    """Put one blank line between the blocks of a Markdown text, and none inside tables and lists."""
    lines: list[str] = []
    before = ""
    for line in filter(None, (line.rstrip() for line in text.splitlines())):
        kind = line[0] if line[0] in _RUNS else ""
        if lines and not (kind and kind == before):
            lines.append("")
        lines.append(line)
        before = kind
    return "\n".join(lines) + "\n"


def _environment(*, escapes: bool) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE / "templates"),
        # Markdown is not HTML; what goes into it comes from this package and its own data files.
        autoescape=escapes,  # noqa: S701
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(cell_text=_cell_text, html_cell=_html_cell)
    environment.globals.update(
        css=_css, encoded=lambda content: base64.b64encode(content).decode("ascii")
    )
    return environment


def _css(verdict: Verdict) -> str:
    return verdict.name.lower().replace("_", "-")


def _cell_text(text: str) -> str:
    """Return a text that keeps a Markdown table whole."""
    return " ".join(text.replace("|", "\\|").split())


def _html_cell(text: str) -> Markup:
    """Return a cell of a table, given as in Markdown."""
    mark = Markup("")
    if found := _MARKED.fullmatch(text):
        text = found[1]
        verdict = next(verdict for verdict in Verdict if verdict.symbol == found[2])
        mark = Markup(' <span class="{}" title="{}">{}</span>').format(
            _css(verdict), verdict.value, verdict.symbol
        )
    shown = escape(text)
    if found := _STRONG.fullmatch(text):
        text = found[1]
        shown = Markup("<strong>{}</strong>").format(text)
    kind = Markup(' class="number"') if _NUMBER.fullmatch(text) else Markup("")
    return Markup("<td{}>{}{}</td>").format(kind, shown, mark)

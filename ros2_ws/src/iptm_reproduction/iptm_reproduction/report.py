"""From a store to the finished pages: HTML with everything inside, and Markdown with a folder of figures."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import jinja2

from iptm_core.errors import StoreError
from iptm_reproduction.chapters import compose
from iptm_reproduction.check import Verdict
from iptm_reproduction.document import Document
from iptm_reproduction.gathering import gather
from iptm_studies.campaign import Campaign
from iptm_studies.store import ResultStore

NAME = "paper-reproduction"
"""Name of the pages, and of the folder of their figures."""


def build_report(store: ResultStore, campaign: Campaign, output_dir: Path) -> tuple[Path, ...]:
    """Write the report from what is stored; nothing is computed.

    Args:
        store: where the runs are.
        campaign: studies that were compared with the store (``execution.survey``). Runs that are missing
            leave notes in the report.
        output_dir: where ``paper-reproduction.html`` (one file with everything inside),
            ``paper-reproduction.md`` and the folder of its figures go.

    Returns:
        The pages.

    Raises:
        ScenarioError: not a single run is there.
        StoreError: a run cannot be read, or the folder cannot be written.
    """
    return write_report(compose(gather(store, campaign)), output_dir)


def write_report(document: Document, output_dir: Path) -> tuple[Path, ...]:
    """Write the pages and the figures; figures that an older report left are removed.

    Returns:
        The pages.

    Raises:
        StoreError: the folder cannot be written.
    """
    folder = output_dir / NAME
    pages = {
        output_dir / f"{NAME}.html": render_html(document).encode(),
        output_dir / f"{NAME}.md": render_markdown(document, NAME).encode(),
    }
    figures = {folder / f"{picture.key}.png": picture.png for picture in document.pictures}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in set(folder.glob("*.png")) - set(figures):
            old.unlink()
        for path, content in {**pages, **figures}.items():
            path.write_bytes(content)
    except OSError as error:
        raise StoreError(f"report cannot be written to {output_dir}: {error}") from error
    return tuple(pages)


_TEMPLATES = Path(__file__).parent / "templates"
_SYMBOLS = {
    Verdict.REPRODUCED: "✓",
    Verdict.SIGN_ONLY: "≈",
    Verdict.NOT_REPRODUCED: "✗",
    Verdict.NOT_TESTED: "–",
}
LEGEND = "Marks: " + ", ".join(f"{symbol} {verdict.value}" for verdict, symbol in _SYMBOLS.items())
_NUMBER = re.compile(r"[+\-−]?[\d. ]+(?: %)?(?: \(.*\))?|–")
_RUNS = "|-"
"""First characters of lines that form one block: table rows and list entries."""


def render_html(document: Document) -> str:
    """Return the page; figures are embedded, so that the one file is all."""
    return (
        _environment(escape=True)
        .get_template("report.html.j2")
        .render(document=document, legend=LEGEND)
    )


def render_markdown(document: Document, folder: str) -> str:
    """Return the page as Markdown.

    Args:
        document: the report.
        folder: where its figures lie, relative to the file.
    """
    template = _environment(escape=False).get_template("report.md.j2")
    text = template.render(folder=folder, document=document, legend=LEGEND)
    return spaced(text)


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


def _environment(*, escape: bool) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        # Markdown is not HTML; what goes into it comes from this package and its own data files.
        autoescape=escape,  # noqa: S701
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(cell_text=_cell_text)
    environment.globals.update(
        kind=lambda block: type(block).__name__,
        symbol=_SYMBOLS.__getitem__,
        css=lambda verdict: verdict.name.lower().replace("_", "-"),
        encoded=lambda content: base64.b64encode(content).decode("ascii"),
        is_number=lambda text: _NUMBER.fullmatch(text) is not None,
    )
    return environment


def _cell_text(text: str) -> str:
    """Return a text that keeps a Markdown table whole."""
    return " ".join(text.replace("|", "\\|").split())

"""One call from a store to the finished pages."""

from __future__ import annotations

from pathlib import Path

from iptm_core.errors import StoreError
from iptm_reproduction.chapters import compose
from iptm_reproduction.document import Document
from iptm_reproduction.gathering import gather
from iptm_reproduction.rendering import render_html, render_markdown
from iptm_studies.campaign import Campaign
from iptm_studies.store import ResultStore

NAME = "paper-reproduction"
"""Name of the pages, and of the folder of their figures."""


def build_report(store: ResultStore, campaign: Campaign, output_dir: Path) -> tuple[Path, ...]:
    """Write the report from what is stored; nothing is computed.

    Args:
        store: where the runs are.
        campaign: studies that were compared with the store (``execution.survey``). Runs that are missing
            leave notes in the report, which say so.
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

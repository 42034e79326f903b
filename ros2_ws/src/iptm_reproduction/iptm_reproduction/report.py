"""One call from a store to the finished pages."""

from __future__ import annotations

from pathlib import Path

from iptm_studies.report.causes import CAUSES_FILE, filled_in, load_causes
from iptm_studies.report.chapters import compose, with_remarks
from iptm_studies.report.claims import CLAIMS_FILE, load_claims
from iptm_studies.report.document import Document
from iptm_studies.report.evaluation import evaluate
from iptm_studies.report.gathering import Gathered, gather
from iptm_studies.report.rendering import render_html, render_markdown

from iptm_core.errors import StoreError
from iptm_studies.campaign import Campaign
from iptm_studies.store import ResultStore

NAME = "paper-reproduction"
"""Name of the pages, and of the folder of their figures."""


def build_report(store: ResultStore, campaign: Campaign, output_dir: Path) -> tuple[Path, ...]:
    """Write the report from what is stored; nothing is computed.

    Args:
        store: where the runs are.
        campaign: studies that were compared with the store (``execution.survey``). Runs that are missing
            leave gaps in the report, which say so.
        output_dir: where ``paper-reproduction.html`` (one file with everything inside),
            ``paper-reproduction.md`` and the folder of its figures go.

    Returns:
        The pages.

    Raises:
        ScenarioError: not a single run is there, or the claims or causes file is malformed.
        StoreError: a run cannot be read, or the folder cannot be written.
    """
    return write_report(document_of(gather(store, campaign)), output_dir)


def document_of(
    gathered: Gathered, claims_file: Path = CLAIMS_FILE, causes_file: Path = CAUSES_FILE
) -> Document:
    """Check every statement and put the report together.

    Args:
        gathered: the runs and where they come from.
        claims_file: what the paper prints.
        causes_file: why results differ.
    """
    paper = load_claims(claims_file)
    causes = load_causes({claim.id for claim in paper.claims}, causes_file)
    results = gathered.results
    reasons = filled_in(causes.claims, results, paper.printed, causes_file.name)
    remarks = filled_in(causes.chapters, results, paper.printed, causes_file.name)
    document = compose(
        results, paper, evaluate(paper, results, reasons), gathered.provenance, gathered.command
    )
    return with_remarks(document, remarks, causes_file.name)


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

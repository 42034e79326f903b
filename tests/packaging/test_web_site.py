"""The web pages are whole: no broken link, no raw formula or diagram, no other host, a list of versions."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from tests.packaging.packages import ROOT

pytest.importorskip("material", reason="requirements/docs.txt is not installed")
LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src"}
"""Attributes of what a browser loads with a page."""


class Page(HTMLParser):
    """Links, identifiers and loaded addresses of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.names: set[str] = set()
        self.classes: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.names |= {given.get("id", ""), given.get("name", "")}
        self.classes |= {*given.get("class", "").split()}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if given.get("rel") not in {"canonical", "sitemap"} and LOADED.get(tag, "") in given:
            self.loaded.append(given[LOADED[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    for name in ("0.1.0", "0.10.0", "0.9.0"):
        (folder / name).mkdir()
        (folder / name / "index.html").write_text("")
    command = [sys.executable, ROOT / "docs" / "web_site.py", folder, "--name", "1.0.0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.fixture(scope="module")
def read(site: Path) -> dict[Path, Page]:
    return {
        path: Page(path) for path in (site / "1.0.0").rglob("*.html") if path.name != "404.html"
    }


def test_the_site_is_made_of_the_pages_and_notebooks_of_the_repository(site: Path) -> None:
    for page in ("index", "docs/tutorial", "docs/reference/commands", "studies/paper/index"):
        assert (site / "1.0.0" / f"{page}.html").is_file(), page
    notebook = (site / "1.0.0/docs/notebooks/first_trip.html").read_text(encoding="utf-8")
    assert "data:image/png" in notebook
    assert "<table" in notebook
    assert 'name": "' not in notebook


def test_no_link_or_anchor_leads_nowhere(read: dict[Path, Page]) -> None:
    assert sum(len(page.links) for page in read.values()) > 4000
    broken = {
        f"{path.name}: {link}"
        for path, page in read.items()
        for link in [*page.links, *page.loaded]
        if not leads_somewhere(path, link, read)
    }
    assert broken == set()


def leads_somewhere(path: Path, link: str, read: dict[Path, Page]) -> bool:
    parts = urlsplit(link)
    if parts.scheme:
        return True
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target in read and parts.fragment:
        return unquote(parts.fragment) in read[target].names
    return target.exists()


def test_a_browser_asks_no_other_host(read: dict[Path, Page], site: Path) -> None:
    loaded = {link for page in read.values() for link in page.loaded}
    assert loaded
    assert {link for link in loaded if urlsplit(link).scheme not in {"", "data"}} == set()
    assert all("@import" not in text and "url(http" not in text for text in styles(site))


def styles(site: Path) -> Iterator[str]:
    for path in site.rglob("*.css"):
        yield path.read_text(encoding="utf-8")


def test_formulas_and_diagrams_are_drawn_when_the_pages_are_made(
    read: dict[Path, Page], site: Path
) -> None:
    raw = {"mermaid", "math", "language-mermaid", "language-math"}
    assert {path.name for path, page in read.items() if page.classes & raw} == set()
    pages = site / "1.0.0/docs"
    assert all("flowchart LR" not in path.read_text(encoding="utf-8") for path in read)
    assert (pages / "architecture.html").read_text(encoding="utf-8").count('<svg id="diagram-') == 2
    comparison = (pages / "explanation/comparison.html").read_text(encoding="utf-8")
    assert comparison.count("<math") == 3


def test_the_versions_are_listed_the_newest_first(site: Path) -> None:
    listed = json.loads((site / "versions.json").read_text(encoding="utf-8"))
    assert [each["version"] for each in listed] == ["1.0.0", "0.10.0", "0.9.0", "0.1.0"]
    assert "1.0.0/index.html" in (site / "index.html").read_text(encoding="utf-8")

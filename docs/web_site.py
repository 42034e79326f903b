"""Makes web pages of the Markdown files of the repository, with MkDocs: ``scripts/dev site [FOLDER]``.

Pages and the files that they link to are copied to a folder of their own, as MkDocs takes one folder; links
to folders, which only a repository can show, become plain text. A link or an anchor that leads nowhere is an
error.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.md", "docs/**/*.md", "studies/*/*.md", "bags/README.md")
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)#\s]+)(#[^)\s]*)?\)")
_IMAGE = re.compile(r'<img src="([^"]+)"')
HEADINGS = (
    ("README.md", "iptm"),
    ("docs/tutorial.md", "Tutorial"),
    ("docs/how-to", "How to"),
    ("docs/reference", "Reference"),
    ("docs/architecture.md", "Architecture"),
    ("docs/explanation", "Explanation"),
    ("studies", "Studies"),
    ("CHANGELOG.md", "Changes"),
    ("CONTRIBUTING.md", "Contributing"),
)


def anchor(title: str, _separator: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def pages() -> list[Path]:
    """Return the pages, relative to the repository."""
    found = {path for pattern in PAGES for path in ROOT.glob(pattern)}
    return sorted(path.relative_to(ROOT) for path in found)


def stage(folder: Path) -> None:
    """Copy the pages and what they link to into a folder."""
    for page in pages():
        text = (ROOT / page).read_text(encoding="utf-8")
        target = folder / page
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(_LINK.sub(partial(_shown, page), text), encoding="utf-8")
        for linked in _linked(page, text):
            copy = folder / linked
            copy.parent.mkdir(parents=True, exist_ok=True)
            if not copy.exists():
                shutil.copy(ROOT / linked, copy)


def _shown(page: Path, link: re.Match[str]) -> str:
    target = (ROOT / page).parent / link[3]
    return link[2] if target.is_dir() else link[0]


def _linked(page: Path, text: str) -> Iterator[Path]:
    """Yield the files other than pages that a page shows or links to."""
    names = [link[3] for link in _LINK.finditer(text)] + _IMAGE.findall(text)
    for name in names:
        target = Path(os.path.normpath((ROOT / page).parent / name))
        if target.is_file() and target.suffix != ".md" and target.is_relative_to(ROOT):
            yield target.relative_to(ROOT)


def settings(source: Path, site: Path) -> dict[str, object]:
    """Return the settings of MkDocs."""
    nav: list[dict[str, object]] = []
    for place, title in HEADINGS:
        inside = [str(page) for page in pages() if page.is_relative_to(place)]
        nav.append({title: inside if len(inside) > 1 else inside[0]})
    return {
        "site_name": "iptm",
        "docs_dir": str(source),
        "site_dir": str(site),
        "use_directory_urls": False,
        "theme": {"name": "readthedocs", "locale": "en"},
        "nav": nav,
        "not_in_nav": "/bags/README.md\n/docs/images/README.md\n",
        "validation": {"anchors": "warn", "unrecognized_links": "warn"},
        "markdown_extensions": [{"toc": {"slugify": "SLUGIFY"}}, "sane_lists"],
    }


def main() -> int:
    """Make the site; return the exit code of MkDocs, which is 1 after a warning."""
    parser = argparse.ArgumentParser("scripts/dev site", description="Make the web pages.")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "results" / "site")
    site = parser.parse_args().folder.resolve()
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "pages"
        stage(source)
        text = yaml.safe_dump(settings(source, site), sort_keys=False)
        # A function, which YAML names by a tag of Python's.
        text = text.replace("SLUGIFY", f"!!python/name:{Path(__file__).stem}.anchor")
        (Path(folder) / "mkdocs.yml").write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
        command += ["--config-file", str(Path(folder) / "mkdocs.yml")]
        done = subprocess.run(command, env=environment, check=False)  # noqa: S603  our own arguments
    if done.returncode == 0:
        print(site / "index.html")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())

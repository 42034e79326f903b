"""Makes web pages of Markdown files and notebooks, with MkDocs: ``scripts/dev site [FOLDER]``.

FOLDER holds the pages of each version in a folder of its own, and a list of the versions. Formulas become
MathML and diagrams SVG while the pages are made, so that a browser needs no other host. Pages and the files
that they link to are copied to one folder first, as MkDocs takes one; links to folders, which only a
repository can show, become plain text. A link or an anchor that leads nowhere is an error.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import mmdr
import yaml
from latex2mathml.converter import convert

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.md", "docs/**/*.md", "studies/**/*.md", "bags/README.md")
NOTEBOOKS = "docs/notebooks/*.ipynb"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)#\s]+)(#[^)\s]*)?\)")
_IMAGE = re.compile(r'<img src="([^"]+)"')
HEADINGS = (
    ("README.md", "iptm"),
    ("docs/tutorial.md", "Tutorial"),
    ("docs/how-to", "How to"),
    ("docs/notebooks", "Notebooks"),
    ("docs/reference", "Reference"),
    ("docs/architecture.md", "Architecture"),
    ("docs/explanation", "Explanation"),
    ("studies", "Studies"),
    ("CHANGELOG.md", "Changes"),
    ("CONTRIBUTING.md", "Contributing"),
)
_LOOKS = (("default", "light", "dark"), ("slate", "dark", "light"))
"""Colour scheme, what a browser prefers for it, and the mode that its button leads to."""
VERSIONS = "versions.json"
"""Versions in a folder, as the selector of the theme reads them."""
_DIAGRAM_STYLE = "background: #fff; overflow-x: auto; padding: 0.5rem"


def anchor(title: str, _separator: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def diagram(source: str, *_: Any, **__: Any) -> str:
    """Return a diagram in Mermaid's language as SVG."""
    own = f"diagram-{hashlib.md5(source.encode(), usedforsecurity=False).hexdigest()[:8]}"
    drawn = (
        mmdr.render(source).svg().replace("merman", own).replace('width="100%"', 'width="1000"', 1)
    )
    return f'<div style="{_DIAGRAM_STYLE}">{drawn}</div>'


def formula(source: str, *_: Any, **__: Any) -> str:
    """Return a formula in TeX as MathML."""
    return f'<div style="overflow-x: auto">{convert(source, display="block")}</div>'


def pages() -> list[Path]:
    """Return the pages, relative to the repository; a notebook is one, too."""
    found = {path for pattern in (*PAGES, NOTEBOOKS) for path in ROOT.glob(pattern)}
    return sorted(path.relative_to(ROOT) for path in found)


def stage(folder: Path) -> None:
    """Copy the pages and what they link to into a folder."""
    for page in pages():
        text = (ROOT / page).read_text(encoding="utf-8")
        if page.suffix == ".ipynb":
            text = notebook_page(text)
        target = folder / _staged(page)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(_LINK.sub(partial(_shown, page), text), encoding="utf-8")
        for linked in _linked(page, text):
            copy = folder / linked
            copy.parent.mkdir(parents=True, exist_ok=True)
            if not copy.exists():
                shutil.copy(ROOT / linked, copy)


def notebook_page(text: str) -> str:
    """Return a notebook with its outputs as a page."""
    parts: list[str] = []
    for cell in json.loads(text)["cells"]:
        source = "".join(cell["source"])
        parts.append(f"```python\n{source}\n```" if cell["cell_type"] == "code" else source)
        parts += map(_output, cell.get("outputs", []))
    return "\n\n".join(parts)


def _output(output: dict[str, Any]) -> str:
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "image/png" in data:
        picture = "".join(data["image/png"].split())
        return f'<img alt="" src="data:image/png;base64,{picture}">'
    if "text/html" in data:
        table = re.sub(r"<style.*?</style>|\n\s*\n", "", data["text/html"], flags=re.DOTALL)
        return f'<div style="overflow-x: auto">{table}</div>'
    return f"```text\n{data.get('text/plain', ''.join(output.get('text', '')))}\n```"


def _staged(page: Path) -> Path:
    return page.with_suffix(".md")


def _shown(page: Path, link: re.Match[str]) -> str:
    if ((ROOT / page).parent / link[3]).is_dir():
        return link[2]
    return link[0].replace(".ipynb", ".md")


def _linked(page: Path, text: str) -> Iterator[Path]:
    """Yield the files other than pages that a page shows or links to."""
    names = [link[3] for link in _LINK.finditer(text)] + _IMAGE.findall(text)
    for name in names:
        target = Path(os.path.normpath((ROOT / page).parent / name))
        is_page = target.suffix in {".md", ".ipynb"}
        if target.is_file() and not is_page and target.is_relative_to(ROOT):
            yield target.relative_to(ROOT)


def version() -> str:
    """Return the version of the suite."""
    found = re.search(
        r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text("utf-8"), re.MULTILINE
    )
    return found[1] if found else "unknown"


def settings(source: Path, site: Path) -> dict[str, object]:
    """Return the settings of MkDocs."""
    nav: list[dict[str, object]] = []
    for place, title in HEADINGS:
        inside = [str(_staged(page)) for page in pages() if page.is_relative_to(place)]
        inside = [page for page in inside if "/data/" not in page]
        nav.append({title: inside if len(inside) > 1 else inside[0]})
    palette = [
        {
            "scheme": scheme,
            "media": f"(prefers-color-scheme: {preferred})",
            "toggle": {"icon": "material/brightness-6", "name": f"Switch to {other} mode"},
        }
        for scheme, preferred, other in _LOOKS
    ]
    fences = [
        {"name": name, "class": name, "format": function}
        for name, function in (("mermaid", "DIAGRAM"), ("math", "FORMULA"))
    ]
    return {
        "site_name": "iptm",
        "docs_dir": str(source),
        "site_dir": str(site),
        "use_directory_urls": False,
        "theme": {"name": "material", "font": False, "palette": palette},
        "extra": {"version": {"provider": "mike"}, "generator": False},
        "plugins": ["search"],
        "nav": nav,
        "not_in_nav": "/bags/README.md\n/docs/images/README.md\n/studies/*/data/\n",
        "validation": {"anchors": "warn", "unrecognized_links": "warn"},
        "markdown_extensions": [
            {"toc": {"slugify": "ANCHOR"}},
            "sane_lists",
            "pymdownx.highlight",
            {"pymdownx.superfences": {"custom_fences": fences}},
        ],
    }


def _numbers(name: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", name)]


def list_versions(folder: Path) -> None:
    """Write the list of the versions in a folder, and a page that leads to the newest."""
    names = sorted({path.parent.name for path in folder.glob("*/index.html")}, key=_numbers)[::-1]
    listed = [{"version": name, "title": name, "aliases": []} for name in names]
    (folder / VERSIONS).write_text(json.dumps(listed), encoding="utf-8")
    refresh = f'<meta http-equiv="refresh" content="0; url={names[0]}/index.html">'
    (folder / "index.html").write_text(f"<!doctype html>{refresh}\n", encoding="utf-8")


def main() -> int:
    """Make the site; return the exit code of MkDocs, which is 1 after a warning."""
    parser = argparse.ArgumentParser("scripts/dev site", description="Make the web pages.")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "results" / "site")
    parser.add_argument("--name", default=version(), help="folder of this version (its number)")
    given = parser.parse_args()
    site = given.folder.resolve() / given.name
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "pages"
        stage(source)
        text = yaml.safe_dump(settings(source, site), sort_keys=False)
        # Functions, which YAML names by a tag of Python's.
        for function in (anchor, diagram, formula):
            tag = f"!!python/name:{Path(__file__).stem}.{function.__name__}"
            text = text.replace(function.__name__.upper(), tag)
        (Path(folder) / "mkdocs.yml").write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
        environment = {
            **os.environ,
            "PYTHONPATH": str(Path(__file__).parent),
            "NO_MKDOCS_2_WARNING": "1",  # its word on what will follow it
        }
        command += ["--config-file", str(Path(folder) / "mkdocs.yml")]
        done = subprocess.run(command, env=environment, check=False)  # noqa: S603  our own arguments
    if done.returncode == 0:
        list_versions(site.parent)
        print(site / "index.html")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())

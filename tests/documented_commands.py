"""Every command line that the documentation shows, and the file that shows it.

They are taken from fenced `bash` blocks and code spans of all pages, from the text of each command in
`scripts/` (which `--help` prints) and from strings of modules (docstrings, `--help`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_PROGRAMS = (
    r"(?:[A-Z_]+=\S+ )*"
    r"(?:scripts/\w+|ros2 \w|\.venv/bin/python|python3? |source |rviz2|colcon |rosdep )"
)
_LINE = re.compile(rf"^\s{{2,}}({_PROGRAMS}.*)$", re.MULTILINE)
_SPAN = re.compile(rf"`({_PROGRAMS}[^`]* [^`]*)`")
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_CONTINUED = re.compile(r"\\\n\s*")
_COMMENT = re.compile(r"\s+# .*$")
_EXPLANATION = re.compile(r"\s{2,}[^-].*$")


def documented_commands() -> dict[str, str]:
    """Return the first file, relative to the repository, that shows each command line."""
    found: dict[str, str] = {}
    for file, text in (*_of_pages(), *_of_programs()):
        found.setdefault(" ".join(text.split()), str(file.relative_to(ROOT)))
    return found


def _of_pages() -> Iterator[tuple[Path, str]]:
    for page in (*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))):
        if page.name == "CHANGELOG.md":
            continue
        text = page.read_text(encoding="utf-8")
        for language, block in _BLOCK.findall(text):
            if language == "bash":
                lines = _CONTINUED.sub("", block).splitlines()
                yield from ((page, _COMMENT.sub("", line)) for line in lines if line.strip())
        prose = _BLOCK.sub("", text).replace("\n", " ")
        yield from ((page, span) for span in _SPAN.findall(prose))


def _of_programs() -> Iterator[tuple[Path, str]]:
    for file in sorted((ROOT / "scripts").iterdir()):
        if file.is_file():
            head = file.read_text(encoding="utf-8").partition("set -euo")[0]
            text = re.sub(r"^# ?", "", head, flags=re.MULTILINE)
            yield from ((file, _plain(line)) for line in _LINE.findall(text))
    for folder in ("ros2_ws/src", "studies", "docs"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            source = file.read_text(encoding="utf-8")
            if not _LINE.search(source):
                continue
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield from ((file, _plain(line)) for line in _LINE.findall(node.value))


def _plain(line: str) -> str:
    """Return a command line of a plain text without the explanation behind it."""
    return _EXPLANATION.sub("", _COMMENT.sub("", line))

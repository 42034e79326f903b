"""The tree holds no trace of the machine it was made on, no large file, its licence, and plain English."""

import re
from pathlib import Path

from tests.packaging.packages import ROOT

# "/home/someone" and "/home/user" are placeholders.
FORBIDDEN = {
    "a home or work folder": re.compile(
        rb"/(?:root|work|home/(?!someone|user)[a-z]\w*|Users/\w+|tmp/w)/[\w.]"
    ),
    "the host of a package registry": re.compile(
        rb"(?:pypi|pythonhosted|npmjs|crates|anaconda)\.(?:org|com|io)|registry\.\w+\.\w+"
    ),
}


def test_no_machine_path_and_no_registry_host(tracked_files: list[Path]) -> None:
    found = [
        f"{path.relative_to(ROOT)}: {what}: {match.group(0)!r}"
        for path in tracked_files
        for what, pattern in FORBIDDEN.items()
        for match in pattern.finditer(path.read_bytes())
    ]
    assert found == []


def test_no_large_file(tracked_files: list[Path]) -> None:
    """Runs belong into bags/, which git ignores, but for a small example."""
    large = [
        str(path.relative_to(ROOT)) for path in tracked_files if path.stat().st_size > 4_000_000
    ]
    assert large == []


def test_license_is_complete() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert text.lstrip().startswith("Apache License")
    assert "END OF TERMS AND CONDITIONS" in text
    assert "WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND" in text


MOST_LINES = 500


def test_a_file_is_one_thought_said_in_its_first_line(tracked_files: list[Path]) -> None:
    for path in tracked_files:
        if path.suffix != ".py" or path.name in {"__init__.py", "setup.py"}:
            continue
        lines = path.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= MOST_LINES, path
        head = next(line for line in lines if line and not line.startswith("#"))
        assert head.startswith('"""'), path


DIALECT = re.compile(
    r"\b(?:told|tells|says|said|whom|nobody|whoever|so many|so long|is no)\b", re.IGNORECASE
)
MOST_DIALECT = 60


def test_plain_english(tracked_files: list[Path]) -> None:
    """Words that CONTRIBUTING.md lists stay rare: quotations and tables of renamed fields only."""
    found = [
        f"{name}: {match.group(0)}"
        for path in tracked_files
        for name in [path.relative_to(ROOT).as_posix()]
        if (name.startswith("ros2_ws/") and name.endswith(".py"))
        or (name.startswith("docs/") and name.endswith(".md"))
        or name.startswith("scripts/")
        or name in {"README.md", "CHANGELOG.md"}
        for match in DIALECT.finditer(path.read_text(encoding="utf-8"))
    ]
    assert len(found) < MOST_DIALECT, found

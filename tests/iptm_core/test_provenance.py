"""Commit and versions, as they are stored beside every result."""

import platform
import re
import subprocess
from pathlib import Path

import pytest

from iptm_core.provenance import UNKNOWN, git_revision, versions


def test_revision_of_a_work_tree_and_of_a_changed_one(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", *identity, *arguments], cwd=tmp_path, check=True)

    (tmp_path / "file").write_text("1", encoding="utf-8")
    git("init", "-q")
    git("add", "file")
    git("commit", "-qm", "first")
    assert re.fullmatch("[0-9a-f]{40}", git_revision(tmp_path))
    (tmp_path / "file").write_text("2", encoding="utf-8")
    git_revision.cache_clear()
    assert re.fullmatch("[0-9a-f]{40}-dirty", git_revision(tmp_path))


def test_outside_git_and_without_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_revision(tmp_path) == UNKNOWN
    monkeypatch.setenv("PATH", str(tmp_path))
    assert git_revision(tmp_path / "other") == UNKNOWN


def test_versions_of_what_is_installed() -> None:
    found = versions(["numpy", "no-such-package"])
    assert found["python"] == platform.python_version()
    assert found["numpy"]
    assert "no-such-package" not in found

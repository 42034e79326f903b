"""The commands in scripts/: each explains itself, without installing anything."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tests.packaging.packages import ROOT

COMMANDS = sorted(
    path.name
    for path in (ROOT / "scripts").iterdir()
    if path.is_file() and os.access(path, os.X_OK) and not path.name.endswith("~")
)


@pytest.fixture(scope="module")
def fresh_copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The commands as in a fresh clone, in a folder with a space in its name, nothing set up."""
    copy = tmp_path_factory.mktemp("fresh clone")
    shutil.copytree(ROOT / "scripts", copy / "scripts")
    shutil.copytree(ROOT / "requirements", copy / "requirements")
    return copy


@pytest.mark.parametrize("command", COMMANDS)
def test_help_before_set_up(command: str, fresh_copy: Path) -> None:
    result = subprocess.run(
        [fresh_copy / "scripts" / command, "--help"],
        cwd=fresh_copy,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "usage:" in result.stdout.lower()
    assert f"scripts/{command}" in result.stdout
    assert not (fresh_copy / ".venv").exists(), "asking for help installed something"


def test_environment_says_what_is_missing(fresh_copy: Path) -> None:
    result = subprocess.run(
        ["bash", "-c", "source scripts/env.sh || echo refused"],
        cwd=fresh_copy,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stdout == "refused\n"
    assert "scripts/setup" in result.stderr


def test_files_of_the_current_folder_are_not_run(tmp_path: Path) -> None:
    """A folder of data that somebody else made."""
    for name in ("yaml", "numpy", "can", "csv", "iptm"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('ran')\n", encoding="utf-8")
    command = [ROOT / "scripts" / "iptm", "run", "--list"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr

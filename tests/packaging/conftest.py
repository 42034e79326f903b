"""What the packaging tests share: the files of the repository, and a clone to set up."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tests.packaging.packages import FOLDERS, PACKAGES, ROOT


@pytest.fixture(scope="session")
def tracked_files() -> list[Path]:
    """All files that are or would be committed (those that git ignores are left out)."""
    listing = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        check=False,
        env={**os.environ, "GIT_CONFIG_COUNT": "1", "GIT_CONFIG_KEY_0": "safe.directory"}
        | {"GIT_CONFIG_VALUE_0": str(ROOT)},
    )
    if listing.returncode != 0:
        pytest.skip("not a git work tree")
    return [
        path
        for name in listing.stdout.decode().split("\0")
        if name and (path := ROOT / name).is_file()
    ]


# Makes a "virtual environment" that holds a copy of itself, "installs" by writing a line, and answers -V.
FAKE_PYTHON = """#!/usr/bin/env bash
case "$*" in
    -V) echo "Python 3.11.99" ;;
    "-m venv "*) mkdir -p "${@: -1}/bin" && cp "$0" "${@: -1}/bin/python" && echo venv >> "$FAKE_RECORD" ;;
    "-m pip "*)
        echo "pip $*" >> "$FAKE_RECORD"
        sleep "${FAKE_PIP_SECONDS:-0}"
        if [ -n "${FAKE_LACKING:-}" ] && [[ "$*" == *"$FAKE_LACKING" ]]; then exit 1; fi
        if [ -n "${FAKE_PIP_FAILS:-}" ]; then echo "$FAKE_PIP_FAILS"; exit 1; fi ;;
    "- "*) cat > /dev/null ;;
    "-c import rclpy") [ -n "${FAKE_ROS:-}" ] ;;
    -c*) ;;
    *) exit 9 ;;
esac
"""


TOOLS = """
bash cat cp cut dirname env find flock getconf grep head mkdir mv paste readlink rm sed sha256sum sleep sort
tail tr uname
"""
"""What every Debian has: the machine's own Pythons stay out of reach."""


class Clone:
    """A copy of what scripts/setup needs, with a stand-in for Python."""

    fake_python = FAKE_PYTHON

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.record = folder / "record.txt"
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.add_program("python3", FAKE_PYTHON)
        self.add_program("cc", "#!/bin/sh\n")
        shutil.copytree(ROOT / "scripts", folder / "scripts")
        shutil.copytree(ROOT / "requirements", folder / "requirements")
        for package in PACKAGES:
            (folder / FOLDERS[package].relative_to(ROOT)).mkdir(parents=True)

    def add_program(self, name: str, text: str) -> None:
        program = self.bin / name
        program.write_text(text, encoding="utf-8")
        program.chmod(0o755)

    def environment(self, **extra: str) -> dict[str, str]:
        tools = self.folder / "tools"
        if not tools.exists():
            tools.mkdir()
            for name in TOOLS.split():
                (tools / name).symlink_to(str(shutil.which(name)))
        return {
            "PATH": f"{self.bin}:{tools}",
            "HOME": str(self.folder),
            "FAKE_RECORD": str(self.record),
            **extra,
        }

    def start(self, *arguments: str, **extra: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [self.folder / "scripts" / "setup", *arguments],
            env=self.environment(**extra),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def setup(self, *arguments: str, **extra: str) -> tuple[int, str]:
        process = self.start(*arguments, **extra)
        _, errors = process.communicate(timeout=300)
        return process.returncode, errors

    def calls(self) -> list[str]:
        """What Python was asked to do since the last look."""
        if not self.record.exists():
            return []
        lines = self.record.read_text(encoding="utf-8").splitlines()
        self.record.unlink()
        return lines


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    folder = tmp_path / "a clone"
    folder.mkdir()
    return Clone(folder)

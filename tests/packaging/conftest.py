"""What the packaging tests share: the packages, their modules, and what each module imports."""

import ast
import os
import runpy
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import setuptools

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "ros2_ws" / "src"


@dataclass(frozen=True)
class Module:
    """One Python file of a package and the dotted names it imports (also inside functions)."""

    package: str
    name: str
    path: Path
    imports: frozenset[str]

    @property
    def is_node(self) -> bool:
        """True for the modules that are allowed to know ROS in a package with a pure part."""
        parts = self.name.split(".")
        return len(parts) > 1 and (parts[1] == "node" or parts[1].startswith("node_"))


def _imported_names(tree: ast.AST, module: str, *, is_package: bool) -> frozenset[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = module.split(".")
                kept = len(parents) - node.level + (1 if is_package else 0)
                base = ".".join([*parents[:kept], *([base] if base else [])])
            names.add(base)
            # `from package import module` depends on the module, too.
            names.update(f"{base}.{alias.name}" for alias in node.names)
    return frozenset(names)


def _read_module(package: str, path: Path) -> Module:
    parts = list(path.relative_to(SOURCE / package).with_suffix("").parts)
    is_package = parts[-1] == "__init__"
    name = ".".join(parts[:-1] if is_package else parts)
    tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
    return Module(package, name, path, _imported_names(tree, name, is_package=is_package))


@pytest.fixture(scope="session")
def root() -> Path:
    """The folder of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def modules_of() -> Callable[[str], list[Module]]:
    """Give the function that reads all modules of a package."""

    def read(package: str) -> list[Module]:
        return [
            _read_module(package, path)
            for path in sorted((SOURCE / package / package).rglob("*.py"))
        ]

    return read


@pytest.fixture(scope="session")
def launch_files_of() -> Callable[[str], list[Module]]:
    """Give the function that reads all launch files of a package."""

    def read(package: str) -> list[Module]:
        return [
            _read_module(package, path)
            for path in sorted((SOURCE / package / "launch").glob("*.launch.py"))
        ]

    return read


@pytest.fixture
def manifest_of() -> Callable[[str], ET.Element]:
    """Give the function that reads the package.xml of a package."""

    def read(package: str) -> ET.Element:
        return ET.parse(SOURCE / package / "package.xml").getroot()  # noqa: S314 (our own file)

    return read


@pytest.fixture
def setup_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, Any]]:
    """Give the function that runs the setup.py of a package and returns what it hands to setuptools."""

    def read(package: str) -> dict[str, Any]:
        seen: dict[str, Any] = {}
        monkeypatch.setattr(setuptools, "setup", seen.update)
        monkeypatch.chdir(SOURCE / package)
        runpy.run_path("setup.py", run_name="__main__")
        return seen

    return read


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
        for package in (ROOT / "ros2_ws" / "src").iterdir():
            (folder / "ros2_ws" / "src" / package.name).mkdir(parents=True)

    def add_program(self, name: str, text: str) -> None:
        program = self.bin / name
        program.write_text(text, encoding="utf-8")
        program.chmod(0o755)

    def environment(self, **extra: str) -> dict[str, str]:
        # The machine's own Pythons stay out of reach: only the tools a Debian always has.
        tools = self.folder / "tools"
        if not tools.exists():
            tools.mkdir()
            for name in TOOLS:
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
        _, errors = process.communicate(timeout=60)
        return process.returncode, errors

    def calls(self) -> list[str]:
        """What Python was asked to do since the last look."""
        if not self.record.exists():
            return []
        lines = self.record.read_text(encoding="utf-8").splitlines()
        self.record.unlink()
        return lines


TOOLS = [
    "bash",
    "cat",
    "cp",
    "cut",
    "dirname",
    "env",
    "find",
    "flock",
    "getconf",
    "grep",
    "head",
    "mkdir",
    "mv",
    "paste",
    "readlink",
    "rm",
    "sed",
    "sha256sum",
    "sleep",
    "sort",
    "tail",
    "tr",
    "uname",
]


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    folder = tmp_path / "a clone"
    folder.mkdir()
    return Clone(folder)

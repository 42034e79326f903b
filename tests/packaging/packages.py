"""The packages of the workspace: their modules and what each imports, their package.xml and setup.py."""

import ast
import os
import runpy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock
from xml.etree import ElementTree as ET

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "ros2_ws" / "src"
FOLDERS = {
    path.parent.name: path.parent
    for pattern in ("*/package.xml", "extras/*/package.xml")
    for path in SOURCE.glob(pattern)
}
EXTRAS = sorted(name for name, folder in FOLDERS.items() if folder.parent != SOURCE)
PACKAGES = sorted(FOLDERS)


@dataclass(frozen=True)
class Module:
    """One Python file of a package and the dotted names it imports (also inside functions)."""

    name: str
    imports: frozenset[str]

    @property
    def is_node(self) -> bool:
        """True for the modules that are allowed to know ROS in a package with a pure part."""
        return any(part == "node" or part.startswith("node_") for part in self.name.split(".")[1:])


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


@cache
def _read_module(package: str, path: Path) -> Module:
    parts = list(path.relative_to(FOLDERS[package]).with_suffix("").parts)
    is_package = parts[-1] == "__init__"
    name = ".".join(parts[:-1] if is_package else parts)
    tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
    return Module(name, _imported_names(tree, name, is_package=is_package))


def modules_of(package: str) -> list[Module]:
    """Return all modules of a package."""
    paths = sorted((FOLDERS[package] / package).rglob("*.py"))
    return [_read_module(package, path) for path in paths]


def launch_files_of(package: str) -> list[Module]:
    """Return all launch files of a package."""
    paths = sorted((FOLDERS[package] / "launch").glob("*.launch.py"))
    return [_read_module(package, path) for path in paths]


@cache
def manifest_of(package: str) -> Any:
    """Return the package.xml of a package."""
    return ET.parse(FOLDERS[package] / "package.xml").getroot()  # noqa: S314 (our own file)


@cache
def setup_of(package: str) -> dict[str, Any]:
    """Return what the setup.py of a package hands to setuptools."""
    seen: dict[str, Any] = {}
    before = Path.cwd()
    os.chdir(FOLDERS[package])
    try:
        with mock.patch("setuptools.setup", seen.update):
            runpy.run_path("setup.py", run_name="__main__")
    finally:
        os.chdir(before)
    return seen

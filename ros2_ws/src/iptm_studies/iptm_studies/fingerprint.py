"""Fingerprint of the code and libraries that the numbers of a run depend on.

Comments, docstrings and layout do not count, nor do the nodes, the metrics (they are worked out anew
from the stored run) and the files of parameter sets and cycles (their values are in the key).
"""

from __future__ import annotations

import ast
import hashlib
import platform
import subprocess
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import iptm_controller
import iptm_core
import iptm_plant_sim
import iptm_studies
import iptm_v2x_bridge
from iptm_core.errors import ScenarioError
from iptm_studies.run_spec import RunKind

_PACKAGES = (iptm_core, iptm_plant_sim, iptm_v2x_bridge, iptm_controller)
_WITHOUT = ("iptm_core/metrics/",)
_STUDY_MODULES = {
    RunKind.CLOSED_LOOP: ("closed_loop.py", "single_run.py"),
    RunKind.WHOLE_TRIP: ("closed_loop.py", "single_run.py", "whole_trip*.py"),
}
_LIBRARIES = ("casadi", "numpy")
_REPORTED_LIBRARIES = (*_LIBRARIES, "dask", "distributed", "pyarrow")
UNKNOWN = "unknown"


@lru_cache(maxsize=4)
def code_fingerprint(kind: RunKind) -> str:
    """Digest of the code behind a kind of run, as it was when the process started.

    Raises:
        ScenarioError: a source file cannot be read.
    """
    digest = hashlib.sha256()
    for name, path in sorted(_source_files(kind).items()):
        digest.update(name.encode())
        digest.update(b"\0")
        digest.update(_meaning(path).encode())
        digest.update(b"\0")
    return digest.hexdigest()


def _source_files(kind: RunKind) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for package in _PACKAGES:
        folder = Path(str(package.__file__)).parent
        for path in folder.rglob("*.py"):
            name = f"{folder.name}/{path.relative_to(folder).as_posix()}"
            if not path.name.startswith("node") and not name.startswith(_WITHOUT):
                files[name] = path
    studies = Path(str(iptm_studies.__file__)).parent
    for pattern in _STUDY_MODULES[kind]:
        files |= {f"iptm_studies/{path.name}": path for path in studies.glob(pattern)}
    return files


def _meaning(path: Path) -> str:
    """Source text without comments, docstrings and layout."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise ScenarioError(f"source file {path.name} cannot be read: {error}") from error
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [entry for entry in node.body if not _is_text(entry)] or [ast.Pass()]
    return ast.unparse(tree)


def _is_text(statement: ast.stmt) -> bool:
    """True for a docstring, also one that follows an attribute."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


@lru_cache(maxsize=1)
def library_versions() -> dict[str, str]:
    """Versions of the libraries that the numbers depend on."""
    return {name: _version(name) for name in _LIBRARIES}


def environment_versions() -> dict[str, str]:
    """Versions of interpreter, machine and libraries, for the record."""
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": platform.system(),
        **{name: _version(name) for name in _REPORTED_LIBRARIES},
    }


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return UNKNOWN


@lru_cache(maxsize=1)
def git_revision() -> str:
    """Commit of the source, with ``-dirty`` if it was changed; ``unknown`` outside git."""
    folder = Path(str(iptm_studies.__file__)).parent
    revision = _git(folder, "rev-parse", "HEAD")
    if not revision:
        return UNKNOWN
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "-uno") else revision


def _git(folder: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(  # noqa: S603 - fixed command
            ["git", "-C", str(folder), *arguments],  # noqa: S607 - the user's own git
            capture_output=True,
            text=True,
            timeout=10.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""

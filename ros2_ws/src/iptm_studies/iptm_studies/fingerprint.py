"""Fingerprint of the code and the libraries that the numbers of a run depend on.

Comments, docstrings and layout do not count, nor do the nodes, the metrics (they are recomputed
from the stored run) and the files of parameter sets and cycles (their values are in the key of a run).
The syntax tree is what is left of a source text without them, and the standard library makes it; byte
code would also differ between versions of Python and with every line that is inserted.
"""

from __future__ import annotations

import ast
import hashlib
from functools import lru_cache
from pathlib import Path

import iptm_controller
import iptm_core
import iptm_faults
import iptm_plant_sim
import iptm_v2x_bridge
from iptm_core.errors import ScenarioError
from iptm_core.provenance import installed_version

_PACKAGES = (iptm_core, iptm_plant_sim, iptm_v2x_bridge, iptm_controller, iptm_faults)
_STUDY_MODULES = ("channel_record.py", "closed_loop.py", "run.py", "whole_trip.py")
_LIBRARIES = ("casadi", "numpy")


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Return the digest of code and libraries, as they were when the process asked first."""
    digest = hashlib.sha256()
    for name, path in sorted(source_files().items()):
        digest.update(f"{name}\0{normalised_source(path)}\0".encode())
    for library in _LIBRARIES:
        digest.update(f"{library}\0{installed_version(library)}\0".encode())
    return digest.hexdigest()


def source_files() -> dict[str, Path]:
    """Return the files that count, by ``package/path``."""
    here = Path(__file__).parent
    files = {f"{here.name}/{name}": here / name for name in _STUDY_MODULES}
    for package in _PACKAGES:
        folder = Path(str(package.__file__)).parent
        for path in folder.rglob("*.py"):
            inside = path.relative_to(folder)
            if not path.name.startswith("node") and inside.parts[0] != "metrics":
                files[f"{folder.name}/{inside.as_posix()}"] = path
    return files


def normalised_source(path: Path) -> str:
    """Return a source text without comments, docstrings and layout.

    Raises:
        ScenarioError: the file cannot be read.
    """
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise ScenarioError(f"source file {path.name} cannot be read: {error}") from error
    return ast.unparse(_WithoutDocstrings().visit(tree))


class _WithoutDocstrings(ast.NodeTransformer):
    """Removes every statement that is nothing but a constant: it has no effect."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node

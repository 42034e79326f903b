"""What numbers stand for: a digest of the code and data that made them."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from iptm_core.errors import ParameterError
from iptm_core.provenance import installed_version
from iptm_core.user_input import shown

SUITE = ("iptm_core", "iptm_plant_sim", "iptm_v2x_bridge", "iptm_controller", "iptm")
"""Packages that a trip without ROS runs through."""
LIBRARIES = ("casadi", "numpy")
_DATA = frozenset({".yaml", ".json", ".csv", ".gz", ".npz"})


@lru_cache(maxsize=32)
def fingerprint(packages: tuple[str, ...] = SUITE, libraries: tuple[str, ...] = LIBRARIES) -> str:
    """Return the digest of packages and of the versions of libraries.

    Python code counts without comments, docstrings and layout, data files as they are. Nodes (modules named
    ``node...``) do not count: without ROS they are not run.

    Args:
        packages: names of importable packages.
        libraries: names of distributions.

    Raises:
        ParameterError: a package cannot be found, or a source file cannot be read.
    """
    digest = hashlib.sha256()
    for package in packages:
        for name, path in files_of(package):
            digest.update(f"{name}\0".encode())
            digest.update(bare_source(path) if path.suffix == ".py" else path.read_bytes())
    for library in libraries:
        digest.update(f"{library}\0{installed_version(library)}\0".encode())
    return digest.hexdigest()


def files_of(package: str) -> Iterator[tuple[str, Path]]:
    """Yield name and path of the files of a package that count, in order."""
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ParameterError(f"package is {shown(package)}; allowed: one that can be imported")
    # A namespace package may be found twice: by the search path and by the working directory.
    folders = dict.fromkeys(Path(each).resolve() for each in spec.submodule_search_locations)
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            is_code = path.suffix == ".py" and not path.name.startswith("node")
            if is_code or path.suffix in _DATA:
                yield f"{package}/{path.relative_to(folder).as_posix()}", path


def bare_source(path: Path) -> bytes:
    """Return a source text without comments, docstrings and layout.

    Raises:
        ParameterError: the file cannot be read.
    """
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise ParameterError(f"source file {path.name} cannot be read: {error}") from error
    return ast.dump(_WithoutDocstrings().visit(tree)).encode()


class _WithoutDocstrings(ast.NodeTransformer):
    """Removes every statement that is nothing but a constant: it has no effect."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


def fingerprint_of_files(paths: Iterable[Path]) -> str:
    """Return the digest of some files by name, Python code as in `fingerprint`."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(f"{path.name}\0".encode())
        digest.update(bare_source(path) if path.suffix == ".py" else path.read_bytes())
    return digest.hexdigest()

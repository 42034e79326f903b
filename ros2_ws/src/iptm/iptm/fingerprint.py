"""Digests of code and data that made numbers, and keys of calls.

Keys are equal where function, arguments, files and code are.
"""

from __future__ import annotations

import ast
import hashlib
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache, singledispatch
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import ParameterError
from iptm_core.extras import offered
from iptm_core.user_input import shown
from iptm_ros.recording.run_information import installed_version

SUITE = (
    *("iptm_core", "iptm_plant_sim", "iptm_v2x_bridge", "iptm_controller", "iptm"),
    *(extra.__name__.partition(".")[0] for extra in offered("drives")),
)
"""Packages that a trip without ROS runs through, and extras that read drives."""
LIBRARIES = ("casadi", "numpy")
RECORD = "record.json"
"""A study writes it after its calls, for which it does not count."""
_DATA = frozenset({".yaml", ".json", ".csv", ".gz", ".npz", ".c", ".h"})


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


def used_by(paths: Iterable[Path], folder: Path) -> tuple[frozenset[Path], tuple[str, ...]]:
    """Return what some files import, through others, too: files with their measurements, and extras.

    Args:
        paths: Python files.
        folder: top package whose modules count file by file.
    """
    files: set[Path] = set()
    packages: set[str] = set()
    waiting = list(paths)
    while waiting:
        for module in _imported(waiting.pop()):
            top = module.split(".")[0]
            path = folder.parent / f"{module.replace('.', '/')}.py"
            if top == folder.name and path.is_file() and path not in files:
                files |= {path, *path.parent.glob("data/*.gz")}
                waiting.append(path)
            elif top.startswith("iptm_") and top not in {*SUITE, *packages} and find_spec(top):
                packages.add(top)
                waiting += [each for _, each in files_of(top) if each.suffix == ".py"]
    return frozenset(files), tuple(sorted(packages))


def _imported(path: Path) -> Iterator[str]:
    """Yield the names of modules that a file imports, and those that may be modules."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


KEY_LENGTH = 32


def call_key(function: Callable[..., Any], arguments: Mapping[str, Any]) -> str:
    """Return the key of a call: equal for equal results.

    Raises:
        ParameterError: an argument cannot be described.
    """
    root = function.__module__.rpartition(".")[0]
    code = code_of_package(root) if root and root.split(".")[0] not in SUITE else fingerprint()
    text = repr(((function.__module__, function.__qualname__, code), _plain(arguments)))
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


@lru_cache(maxsize=32)
def code_of_package(root: str) -> str:
    """Return the digest of the suite, a package, and what it imports."""
    folder = Path(next(iter(import_module(root.partition(".")[0]).__path__)))
    own = [path for _, path in files_of(root) if path.name != RECORD]
    files, packages = used_by((path for path in own if path.suffix == ".py"), folder)
    return fingerprint((*SUITE, *packages)) + fingerprint_of_files({*files, *own})


@singledispatch
def _plain(value: Any) -> Any:
    """Return nested tuples of texts and numbers that stand for a value."""
    if is_dataclass(value) and not isinstance(value, type):
        entries = (_plain(getattr(value, entry.name)) for entry in fields(value))
        return type(value).__qualname__, *entries
    if callable(value) and hasattr(value, "__qualname__"):
        return value.__module__, value.__qualname__
    if type(value).__module__.startswith("pandas.") and hasattr(value, "columns"):
        columns = {str(name): value[name].to_numpy() for name in value}
        return "frame", _plain(value.index.to_numpy()), *map(_plain, columns.items())
    try:
        return type(value).__qualname__, _digest(pickle.dumps(value))
    except Exception:  # noqa: BLE001 - pickle raises whatever the object does
        raise ParameterError(
            f"argument is {shown(value)}; allowed with a cache: numbers, texts, arrays, dataclasses and what"
            " can be pickled"
        ) from None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@_plain.register(type(None))
@_plain.register(int)
@_plain.register(float)
@_plain.register(bytes)
def _(value: float | bytes | None) -> Any:
    return value


@_plain.register(str)
@_plain.register(Path)
def _(value: str | Path) -> Any:
    """A file counts by its content, wherever it is."""
    path = Path(value)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        is_file = False
    return ("file", path.name, _digest(path.read_bytes())) if is_file else str(value)


@_plain.register
def _(value: Enum) -> Any:
    return type(value).__qualname__, value.name


@_plain.register(Mapping)
def _(value: Mapping[Any, Any]) -> Any:
    return "map", *sorted((str(key), _plain(entry)) for key, entry in value.items())


@_plain.register(list)
@_plain.register(tuple)
def _(value: list[Any] | tuple[Any, ...]) -> Any:
    return "list", *map(_plain, value)


@_plain.register(np.ndarray)
@_plain.register(np.generic)
def _(value: Any) -> Any:
    array = np.ascontiguousarray(value)
    if array.dtype.hasobject:
        return "list", *map(_plain, array.ravel().tolist())
    return str(array.dtype), array.shape, _digest(array.tobytes())

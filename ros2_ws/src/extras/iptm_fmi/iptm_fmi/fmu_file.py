"""An FMU as a file: description, sources with their build, and a library for this machine."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from iptm_core.compiler import COMPILE_TIMEOUT_S, installed_compiler
from iptm_core.errors import ScenarioError, SolverSetupError
from iptm_fmi.description import build_description, description, source_names
from iptm_fmi.unit import Unit

FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-fPIC",
)
HEADERS = ("Functions.h", "FunctionTypes.h")
_TYPES = {2: "fmi2TypesPlatform.h", 3: "fmi3PlatformTypes.h"}
VERSIONS = (2, 3)
_DATE = (2000, 1, 1, 0, 0, 0)
"""Of every file inside: the same unit gives the same bytes."""


def write_fmus(paths: Mapping[int, Path], unit: Unit) -> None:
    """Write a unit as FMUs by version; without a C compiler they hold the sources only.

    Raises:
        ScenarioError: FMPy, whose headers of FMI are used, is not installed.
        SolverSetupError: the library cannot be compiled.
        OSError: a file cannot be written.
    """
    files = {version: {**unit.files(version), **headers(version)} for version in paths}
    compiler = installed_compiler()
    libraries = {} if compiler is None else compiled(files, compiler)
    for version, path in paths.items():
        contents: dict[str, bytes] = {
            "modelDescription.xml": description(unit, version).encode(),
            "sources/CMakeLists.txt": _cmake(unit, source_names(unit, version)).encode(),
        }
        if version == 3:
            contents["sources/buildDescription.xml"] = build_description(unit).encode()
        contents |= {f"sources/{name}": text.encode() for name, text in files[version].items()}
        if version in libraries:
            contents[f"{library_folder(version)}/{unit.name}.so"] = libraries[version]
        path.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(contents):
                entry = zipfile.ZipInfo(name, _DATE)
                archive.writestr(entry, contents[name], zipfile.ZIP_DEFLATED)


def headers(version: int) -> dict[str, str]:
    """Return the headers of a version of FMI (2-clause BSD), as FMPy has them.

    Raises:
        ScenarioError: it is not installed.
    """
    spec = find_spec("fmpy")
    if spec is None or not spec.submodule_search_locations:
        raise ScenarioError(
            "FMUs need FMPy, which has the headers of FMI; install requirements/fmi.txt"
        )
    folder = Path(spec.submodule_search_locations[0]) / "c-code"
    names = [f"fmi{version}{end}" for end in HEADERS] + [_TYPES[version]]
    return {name: (folder / name).read_text("utf-8") for name in names}


def library_folder(version: int) -> str:
    """Return where the library of this machine is inside an FMU."""
    machine = platform.machine()
    if version == 3:
        return f"binaries/{machine}-linux"
    return "binaries/linux64" if machine == "x86_64" else f"binaries/{machine}-linux"


def compiled(files: Mapping[int, Mapping[str, str]], compiler: tuple[str, ...]) -> dict[int, bytes]:
    """Return the shared libraries of files by version; what they have in common is compiled once.

    Raises:
        SolverSetupError: the compiler fails.
    """
    sources = {version: {n for n in names if n.endswith(".c")} for version, names in files.items()}
    shared = sorted(set.intersection(*sources.values()))
    objects = [f"{name[:-2]}.o" for name in shared]
    found = {}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for texts in files.values():
            for name, text in texts.items():
                (folder / name).write_text(text, "utf-8")
        _run([*compiler, *FLAGS, "-c", *shared], folder)
        for version, names in sources.items():
            rest = sorted(names - {*shared})
            library = f"{version}.so"
            _run([*compiler, *FLAGS, "-shared", "-o", library, *rest, *objects, "-lm"], folder)
            strip = shutil.which("strip")
            if strip is not None:
                subprocess.run([strip, library], cwd=folder, check=False, timeout=60.0)  # noqa: S603
            found[version] = (folder / library).read_bytes()
    return found


def _run(command: Sequence[str], folder: Path) -> None:
    try:
        done = subprocess.run(  # noqa: S603 - the compiler is found on the user's own path
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=COMPILE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SolverSetupError(
            f"compiler {command[0]} did not finish within {COMPILE_TIMEOUT_S:g} s"
        ) from None
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if "error" in line]
        raise SolverSetupError(f"compiler {command[0]} failed: {(lines or ['no message'])[0]}")


def _cmake(unit: Unit, names: list[str]) -> str:
    listed = "\n  ".join(names)
    return f"""cmake_minimum_required(VERSION 3.16)
project({unit.name} C)
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_VISIBILITY_PRESET hidden)
# Operations are done as they are written: no contraction to fused multiply-adds.
add_compile_options(-O2 -ffp-contract=off)
add_library({unit.name} SHARED
  {listed})
set_target_properties({unit.name} PROPERTIES PREFIX "")
target_link_libraries({unit.name} m)
"""

"""An FMU as a file: description, sources with their build, and a library for this machine."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
import zipfile
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
    "-shared",
)
HEADERS = ("Functions.h", "FunctionTypes.h")
_TYPES = {2: "fmi2TypesPlatform.h", 3: "fmi3PlatformTypes.h"}
VERSIONS = (2, 3)
_DATE = (2000, 1, 1, 0, 0, 0)
"""Of every file inside: the same unit gives the same bytes."""


def write_fmu(path: Path, unit: Unit, version: int) -> None:
    """Write an FMU; without a C compiler it holds the sources only.

    Raises:
        ScenarioError: FMPy, whose headers of FMI are used, is not installed.
        SolverSetupError: the library cannot be compiled.
        OSError: the file cannot be written.
    """
    files = {**unit.files(version), **headers(version)}
    names = source_names(unit, version)
    contents: dict[str, bytes] = {
        "modelDescription.xml": description(unit, version).encode(),
        "sources/CMakeLists.txt": _cmake(unit, names).encode(),
    }
    if version == 3:
        contents["sources/buildDescription.xml"] = build_description(unit).encode()
    contents |= {f"sources/{name}": text.encode() for name, text in files.items()}
    compiler = installed_compiler()
    if compiler is not None:
        contents[f"{library_folder(version)}/{unit.name}.so"] = compiled(files, names, compiler)
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(contents):
            archive.writestr(zipfile.ZipInfo(name, _DATE), contents[name], zipfile.ZIP_DEFLATED)


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


def compiled(files: dict[str, str], names: list[str], compiler: tuple[str, ...]) -> bytes:
    """Return the shared library of some of the files.

    Raises:
        SolverSetupError: the compiler fails.
    """
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name, text in files.items():
            (folder / name).write_text(text, "utf-8")
        command = [*compiler, *FLAGS, "-o", "unit.so", *names, "-lm"]
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
                f"compiler {compiler[0]} did not finish within {COMPILE_TIMEOUT_S:g} s"
            ) from None
        if done.returncode != 0:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise SolverSetupError(f"compiler {compiler[0]} failed: {(lines or ['no message'])[0]}")
        strip = shutil.which("strip")
        if strip is not None:
            subprocess.run([strip, "unit.so"], cwd=folder, check=False, timeout=60.0)  # noqa: S603
        return (folder / "unit.so").read_bytes()


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

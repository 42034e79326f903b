"""Files that `iptm fmu` writes: their description, their library, their sources, and refusals."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from tests.extras.iptm_fmi.conftest import versions

from iptm_core.parameters import load_parameters
from iptm_fmi.command import main
from iptm_fmi.fmu_file import library_folder, write_fmus
from iptm_fmi.plant_unit import meter_unit, plant_unit

validation = pytest.importorskip(
    "fmpy.validation", reason="FMPy is not installed (requirements/fmi.txt)"
)
SETS = ("paper_calibrated", "paper_identified", "bmw_i3", "tesla_model_3")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only")


def problems(path: Path) -> list[str]:
    return list(validation.validate_fmu(str(path)))


@pytest.mark.parametrize("name", SETS)
def test_the_validator_finds_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the sources; libraries are those of `test_the_validator_finds_nothing_in_the_paper_set`."""
    monkeypatch.setattr("iptm_fmi.fmu_file.installed_compiler", lambda: None)
    parameters = load_parameters(name).values
    for unit in (plant_unit(parameters), meter_unit(parameters)):
        paths = versions(tmp_path, unit.name)
        write_fmus(paths, unit)
        for path in paths.values():
            assert problems(path) == []


@pytest.mark.parametrize("what", ["plant", "meter", "controller"])
def test_the_validator_finds_nothing_in_the_paper_set(controllers: Path, what: str) -> None:
    for path in versions(controllers, what).values():
        assert problems(path) == []
        assert path.stat().st_size < 1e6


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS[1:])
def test_the_validator_finds_nothing_in_other_controllers(name: str, tmp_path: Path) -> None:
    path = tmp_path / "controller.fmu"
    assert main(["controller", str(path), "--parameter-set", name, "--fmi", "both"]) == 0
    for version in (2, 3):
        assert problems(tmp_path / f"controller_fmi{version}.fmu") == []


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("what", ["plant", "meter", "controller"])
def test_sources_compile_without_a_warning(
    controllers: Path, what: str, compiler: str, tmp_path: Path
) -> None:
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    for version in (2, 3):
        with zipfile.ZipFile(controllers / f"{what}_{version}.fmu") as archive:
            archive.extractall(tmp_path / str(version))
        sources = sorted((tmp_path / str(version) / "sources").glob("*.c"))
        done = subprocess.run(
            [path, *STRICT, *map(str, sources)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("what", ["plant", "meter", "controller"])
def test_libraries_need_the_c_library_only(controllers: Path, what: str, tmp_path: Path) -> None:
    tool = shutil.which("ldd")
    if tool is None:
        pytest.skip("ldd is not installed")
    for version in (2, 3):
        inside = f"{library_folder(version)}/iptm_{what}.so"
        with zipfile.ZipFile(controllers / f"{what}_{version}.fmu") as archive:
            archive.extract(inside, tmp_path)
        listed = subprocess.run(
            [tool, str(tmp_path / inside)], capture_output=True, text=True, check=True
        ).stdout
        names = {re.split(r"[\s.]", line.strip())[0] for line in listed.splitlines()}
        assert names <= {
            "linux-vdso",
            "libc",
            "libm",
            "/lib64/ld-linux-x86-64",
            "/lib/ld-linux-aarch64",
        }


def test_one_unit_gives_the_same_bytes(tmp_path: Path) -> None:
    for number in (1, 2):
        write_fmus({2: tmp_path / f"{number}.fmu"}, plant_unit(load_parameters(SETS[0]).values))
    assert (tmp_path / "1.fmu").read_bytes() == (tmp_path / "2.fmu").read_bytes()


@pytest.mark.slow
def test_the_cmake_file_builds_the_same_library(made: Path, tmp_path: Path) -> None:
    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("cmake is not installed")
    with zipfile.ZipFile(made / "plant_3.fmu") as archive:
        archive.extractall(tmp_path)
    for step in (["-S", "sources", "-B", "build"], ["--build", "build"]):
        subprocess.run([cmake, *step], cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "build" / "iptm_plant.so").is_file()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["plant", "x.fmu", "--parameter-set", "no_such_car"], "no_such_car"),
        (["plant", "x.fmu", "--overrides", "body.mass_kg=-3"], "mass_kg"),
        (["controller", "x.fmu", "--strategy", "production"], "production"),
        (["controller", "x.fmu", "--horizon", "3x1+5x5+10x30t"], "30t"),
    ],
)
def test_what_cannot_be_written_is_refused_in_a_line(
    arguments: list[str],
    named: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    printed = capsys.readouterr().err.strip()
    assert named in printed
    assert "Traceback" not in printed
    assert not list(tmp_path.glob("*.fmu"))


def test_without_fmpy_it_is_said_which_extra_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("iptm_fmi.fmu_file.find_spec", lambda _: None)
    assert main(["plant", str(tmp_path / "x.fmu")]) == 2
    assert "requirements/fmi.txt" in capsys.readouterr().err

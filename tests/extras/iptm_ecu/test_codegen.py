"""The controller as C99: compiled without a warning, deciding what Python decided, without allocation."""

from __future__ import annotations

import ctypes
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from iptm_controller.ladder import controlled_stop, safe_following
from iptm_controller.options import ControllerOptions
from iptm_controller.tick_library import CLeader, numbers_of, vehicle
from iptm_core.parameters import available_parameter_sets, load_parameters
from iptm_core.state import LeaderState, VehicleState
from iptm_ecu.codegen import code_of
from iptm_ecu.command import main

PARAMETERS = load_parameters().values
FLAGS = [
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Werror",
    "-O1",
    "-ffp-contract=off",
]
SANITIZED = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]
CARS = available_parameter_sets()
MATHEMATICS = {
    "cos",
    "exp",
    "expm1",
    "fabs",
    "fmax",
    "fmod",
    "log",
    "log1p",
    "pow",
    "rint",
    "sin",
    "sincos",
    "sqrt",
}
ALLOWED = {*MATHEMATICS, "memcpy", "memmove", "memset"}
DOUBLE, INT = ctypes.c_double, ctypes.c_int


def written(tmp_path: Path, *arguments: str) -> Path:
    folder = tmp_path / "ecu"
    assert main([str(folder), *arguments]) == 0
    return folder


@pytest.mark.parametrize(
    "arguments",
    [
        ("--ticks", "90"),
        ("--ticks", "40", "--horizon", "6x1", "--strategy", "energy_aging"),
        ("--ticks", "40", "--parameter-set", "at_headway.yaml"),
        ("--ticks", "60", "--parameter-set", "tesla_model_y", "--cycle", "us06"),
        *(
            pytest.param(
                ("--ticks", "300", "--parameter-set", car, "--cycle", "us06"),
                marks=pytest.mark.slow,
            )
            for car in CARS
        ),
    ],
)
def test_recorded_ticks_are_decided_alike(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    compiler: tuple[str, ...],
    arguments: tuple[str, ...],
) -> None:
    headway = "gap: {desired_time_headway_s: {value: 1.6, unit: s, source: chosen}}"
    text = f"description: at a headway\nbase: paper_calibrated\n{headway}\n"
    (tmp_path / "at_headway.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    folder = written(tmp_path, *arguments)
    bench, ticks = folder / "bench", folder / "ticks.bin"
    subprocess.run(
        [*compiler, *FLAGS, *folder.glob("*.c"), "-o", bench, "-lm"], check=True, timeout=300
    )
    done = subprocess.run([bench, ticks], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f"{arguments[1]} ticks")
    assert "largest difference 0 m/s^2 and 0 W; 0 other rungs" in done.stdout
    # A command that is not the recorded one is found.
    numbers = np.fromfile(ticks)
    numbers[-2] += 1.0
    numbers.tofile(ticks)
    assert subprocess.run([bench, ticks], check=False).returncode == 1


@pytest.mark.slow
def test_no_input_leads_out_of_the_bounds_or_of_memory(
    tmp_path: Path, compiler: tuple[str, ...]
) -> None:
    """20,000 ticks of which some numbers are not finite, absurd or missing."""
    folder = written(tmp_path, "--ticks", "1", "--parameter-set", "bmw_i3")
    (folder / "bench.c").unlink()
    sources = *folder.glob("*.c"), Path(__file__).with_name("fuzz.c")
    program = folder / "fuzz"
    options = [*FLAGS, *SANITIZED, f"-I{folder}"]
    built = subprocess.run(
        [*compiler, *options, *sources, "-o", program, "-lm"],
        capture_output=True,
        timeout=300,
        check=False,
    )
    if built.returncode != 0 and b"san" in built.stderr:
        pytest.skip("no sanitizers on this machine")
    done = subprocess.run([program, "20000", "1"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rungs = done.stdout.split("rungs")[1].split()
    assert all(int(rung) > 1000 for rung in rungs), "each rung is reached"


def test_build_of_cmake(tmp_path: Path, compiler: tuple[str, ...]) -> None:
    """In single precision, in which some ticks choose another plan."""
    if shutil.which("cmake") is None:
        pytest.skip("no CMake on this machine")
    folder = written(tmp_path, "--ticks", "90")
    build, decisions = tmp_path / "build", tmp_path / "decisions.txt"
    configure = ["cmake", "-S", folder, "-B", build, "-DIPTM_FLOAT=ON"]
    for command in (
        [*configure, f"-DCMAKE_C_COMPILER={';'.join(compiler)}"],
        ["cmake", "--build", build],
        ["ctest", "--test-dir", build],
        [build / "bench", folder / "ticks.bin", decisions],
    ):
        subprocess.run(command, check=True, timeout=300, capture_output=True)
    off_m_s2, off_w = np.loadtxt(decisions)[:, :2].T
    assert np.median(np.abs(off_m_s2)) <= 1e-4
    assert np.median(np.abs(off_w)) <= 0.1
    assert np.any(off_m_s2)


def test_memory_is_static_and_what_the_solver_lays_out(
    tmp_path: Path, compiler: tuple[str, ...]
) -> None:
    """That no object asks for memory is seen from what the linker would have to find."""
    if shutil.which("nm") is None:
        pytest.skip("no nm on this machine")
    folder = written(tmp_path, "--ticks", "1", "--horizon", "2x1+3x5")
    (folder / "bench.c").unlink()
    command = [*compiler, *FLAGS, "-c", *folder.glob("*.c")]
    subprocess.run(command, cwd=folder, check=True, timeout=300)
    objects = [*folder.glob("*.o")]
    listed = subprocess.run(
        ["nm", "-P", *objects], capture_output=True, text=True, check=True
    ).stdout
    kinds = [line.split()[:2] for line in listed.splitlines() if not line.endswith(":")]
    outside = {name for name, kind in kinds if kind == "U"} - {
        name for name, kind in kinds if kind != "U"
    }
    assert {"log", "exp"} <= outside
    assert outside <= ALLOWED

    (folder / "sizes.c").write_text(
        '#include "controller.h"\n#include <stdio.h>\n'
        "int main(void) {\n"
        '  printf("%d %d\\n", (int)iptm_checked_work_size(&iptm_horizon_of_solver),\n'
        "         (int)IPTM_CHECKED_WORK_SIZE(IPTM_STEPS, IPTM_MAX_ITERATIONS));\n"
        "  return 0;\n}\n"
    )
    command = [*compiler, *FLAGS, folder / "sizes.c", *objects, "-o", folder / "sizes", "-lm"]
    subprocess.run(command, check=True, timeout=300)
    laid_out, reserved = subprocess.run(
        [folder / "sizes"], capture_output=True, text=True, check=True
    ).stdout.split()
    assert laid_out == reserved


def test_thermal_phases_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "ecu"), "--horizon", "3x1+5x5+10x30t"]) == 2
    assert "allowed for C: phases of motion" in capsys.readouterr().err
    assert not (tmp_path / "ecu").exists()


class CPair(ctypes.Structure):
    """A command."""

    _fields_ = [("first", DOUBLE), ("second", DOUBLE)]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory, compiler: tuple[str, ...]) -> ctypes.CDLL:
    """The parts that need no solver, with the numbers of a controller."""
    folder = tmp_path_factory.mktemp("parts")
    files = code_of(PARAMETERS, ControllerOptions())
    for name, text in files.items():
        (folder / name).write_text(text)
    parts = ["fallback.c", "controller_data.c"]
    built = folder / "parts.so"
    command = [*compiler, *FLAGS, "-shared", "-fPIC", *parts, "-o", str(built), "-lm"]
    subprocess.run(shlex.split(shlex.join(command)), cwd=folder, check=True, timeout=300)
    found = ctypes.CDLL(str(built))
    for name in ("iptm_safe_following", "iptm_controlled_stop"):
        getattr(found, name).restype = CPair
    return found


def some_state(rng: np.random.Generator) -> VehicleState:
    return VehicleState(
        time_s=0.0,
        position_m=float(rng.uniform(0.0, 100.0)),
        speed_m_s=float(rng.choice([0.0, rng.uniform(0.0, 40.0)])),
        acceleration_m_s2=float(rng.uniform(-9.0, 4.0)),
        compressor_power_w=float(rng.uniform(-100.0, 6000.0)),
        cell_1_temperature_k=float(rng.uniform(280.0, 320.0)),
        cell_n_temperature_k=float(rng.uniform(280.0, 320.0)),
        cell_1_capacity_loss=1e-3,
        cell_n_capacity_loss=1e-3,
    )


def test_fallback_is_that_of_python(library: ctypes.CDLL) -> None:
    ego, write = vehicle()
    limits = ctypes.c_char.in_dll(library, "iptm_limits_of_model")
    rng = np.random.default_rng(2)
    for _ in range(3000):
        state = some_state(rng)
        write(*numbers_of(state))
        leader = LeaderState(
            0.0, state.position_m + float(rng.uniform(-2.0, 80.0)), float(rng.uniform(0.0, 40.0))
        )
        following = library.iptm_safe_following(
            ctypes.byref(limits),
            ctypes.byref(ego),
            ctypes.byref(CLeader(0.0, leader.position_m, leader.speed_m_s)),
        )
        expected = safe_following(state, leader, PARAMETERS)
        assert following.first == pytest.approx(expected.acceleration_m_s2, abs=1e-12)
        assert following.second == expected.compressor_power_w
        stop = library.iptm_controlled_stop(ctypes.byref(limits), ctypes.byref(ego))
        expected = controlled_stop(state, PARAMETERS, 1.0)
        assert (stop.first, stop.second) == (
            expected.acceleration_m_s2,
            expected.compressor_power_w,
        )

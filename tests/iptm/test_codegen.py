"""The controller as C99: compiled without a warning, deciding what Python decided, without allocation."""

from __future__ import annotations

import ctypes
import math
import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm.codegen import code_of
from iptm.commands.drives import codegen as main
from iptm_controller.ladder import controlled_stop, safe_following
from iptm_controller.ocp.compilation import find_compiler
from iptm_controller.options import ControllerOptions
from iptm_controller.safeguards import CommandLimiter
from iptm_core.monitor_settings import SafetyMonitorSettings
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, LeaderState, VehicleState
from iptm_plant_sim.safety_monitor import MonitorMemory, SafetyMonitor, with_delivery

PARAMETERS = load_parameters().values
FLAGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off"]
MATHEMATICS = {"cos", "exp", "expm1", "fabs", "fmax", "log", "pow", "sin", "sincos", "sqrt"}
ALLOWED = {*MATHEMATICS, "memcpy", "memset"}
DOUBLE, INT = ctypes.c_double, ctypes.c_int


@pytest.fixture(scope="session")
def compiler() -> tuple[str, ...]:
    found = find_compiler()
    if found is None:
        pytest.skip("no C compiler on this machine")
    return found


def written(tmp_path: Path, *arguments: str) -> Path:
    folder = tmp_path / "ecu"
    assert main([str(folder), *arguments]) == 0
    return folder


@pytest.mark.parametrize(
    "arguments",
    [("--ticks", "90"), ("--ticks", "40", "--horizon", "6x1", "--strategy", "energy_aging")],
)
def test_recorded_ticks_are_decided_alike(
    tmp_path: Path, compiler: tuple[str, ...], arguments: tuple[str, ...]
) -> None:
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


@pytest.mark.parametrize(("precision", "median"), [("OFF", 0.0), ("ON", 1e-4)])
def test_build_of_cmake(
    tmp_path: Path, compiler: tuple[str, ...], precision: str, median: float
) -> None:
    """Solver in double and in single precision; in the latter, some ticks choose another plan."""
    if shutil.which("cmake") is None:
        pytest.skip("no CMake on this machine")
    folder = written(tmp_path, "--ticks", "90")
    build, decisions = tmp_path / "build", tmp_path / "decisions.txt"
    configure = ["cmake", "-S", folder, "-B", build, f"-DIPTM_FLOAT={precision}"]
    for command in (
        [*configure, f"-DCMAKE_C_COMPILER={';'.join(compiler)}"],
        ["cmake", "--build", build],
        ["ctest", "--test-dir", build],
        [build / "bench", folder / "ticks.bin", decisions],
    ):
        subprocess.run(command, check=True, timeout=300, capture_output=True)
    off_m_s2, off_w = np.loadtxt(decisions)[:, :2].T
    assert np.median(np.abs(off_m_s2)) <= median
    assert np.median(np.abs(off_w)) <= 1000.0 * median
    assert np.any(off_m_s2) == np.any(off_w) == (precision == "ON")


def test_no_object_asks_for_memory(tmp_path: Path, compiler: tuple[str, ...]) -> None:
    """Seen from what the linker would have to find."""
    if shutil.which("nm") is None:
        pytest.skip("no nm on this machine")
    folder = written(tmp_path, "--ticks", "1", "--horizon", "2x1")
    sources = [path for path in folder.glob("*.c") if path.name != "bench.c"]
    subprocess.run([*compiler, *FLAGS, "-c", *sources], cwd=folder, check=True, timeout=300)
    listed = subprocess.run(
        ["nm", "-P", *folder.glob("*.o")], capture_output=True, text=True, check=True
    ).stdout
    kinds = [line.split()[:2] for line in listed.splitlines() if not line.endswith(":")]
    outside = {name for name, kind in kinds if kind == "U"} - {
        name for name, kind in kinds if kind != "U"
    }
    assert {"log", "exp"} <= outside
    assert outside <= ALLOWED


def test_static_memory_is_what_the_solver_lays_out(
    tmp_path: Path, compiler: tuple[str, ...]
) -> None:
    folder = written(tmp_path, "--ticks", "1", "--horizon", "2x1+3x5")
    (folder / "bench.c").write_text(
        '#include "controller.h"\n#include <stdio.h>\n'
        "int main(void) {\n"
        '  printf("%d %d\\n", (int)iptm_checked_work_size(&iptm_horizon_of_solver),\n'
        "         (int)IPTM_CHECKED_WORK_SIZE(IPTM_STEPS, IPTM_MAX_ITERATIONS));\n"
        "  return 0;\n}\n"
    )
    bench = folder / "bench"
    subprocess.run(
        [*compiler, *FLAGS, *folder.glob("*.c"), "-o", bench, "-lm"], check=True, timeout=300
    )
    laid_out, reserved = subprocess.run(
        [bench], capture_output=True, text=True, check=True
    ).stdout.split()
    assert laid_out == reserved


def test_thermal_phases_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "ecu"), "--horizon", "3x1+5x5+10x30t"]) == 2
    assert "allowed for C: phases of motion" in capsys.readouterr().err
    assert not (tmp_path / "ecu").exists()


class CVehicle(ctypes.Structure):
    _fields_ = [
        (name, DOUBLE)
        for name in ("time", "position", "speed", "cell_1", "cell_n", "acceleration", "power")
    ]


class CPair(ctypes.Structure):
    """A command, or a leader."""

    _fields_ = [("first", DOUBLE), ("second", DOUBLE)]


class CMonitorMemory(ctypes.Structure):
    _fields_ = [
        ("braking", INT),
        ("gently", INT),
        *((name, DOUBLE) for name in ("since_s", "brake_share", "followed_m_s2", "road_m_s2")),
    ]


class CRoad(ctypes.Structure):
    _fields_ = [("full", CPair), ("slippery", CPair), ("may_be_slippery", INT)]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory, compiler: tuple[str, ...]) -> ctypes.CDLL:
    """The parts that need no solver, with the numbers of a controller."""
    folder = tmp_path_factory.mktemp("parts")
    files = code_of(PARAMETERS, ControllerOptions())
    for name, text in files.items():
        (folder / name).write_text(text)
    parts = ["limiter.c", "fallback.c", "safety_monitor.c", "controller_data.c"]
    built = folder / "parts.so"
    command = [*compiler, *FLAGS, "-shared", "-fPIC", *parts, "-o", str(built), "-lm"]
    subprocess.run(shlex.split(shlex.join(command)), cwd=folder, check=True, timeout=100)
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


def vehicle(state: VehicleState) -> CVehicle:
    return CVehicle(
        state.time_s,
        state.position_m,
        state.speed_m_s,
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.acceleration_m_s2,
        state.compressor_power_w,
    )


def test_limiter_is_that_of_python(library: ctypes.CDLL) -> None:
    limits = ctypes.c_char.in_dll(library, "iptm_limits_of_model")
    limiter = CommandLimiter(PARAMETERS.limits, 1.0)
    bits = {
        "acceleration not finite": 1,
        "compressor power not finite": 2,
        "acceleration bound": 4,
        "top speed": 8,
        "jerk": 16,
        "compressor power bound": 32,
        "compressor rate": 64,
    }
    rng = np.random.default_rng(1)
    seen = 0
    for _ in range(3000):
        state = some_state(rng)
        wanted = Command(
            float(rng.choice([rng.uniform(-12.0, 12.0), math.nan, -math.inf])),
            float(rng.choice([rng.uniform(-1e3, 1e4), math.nan, math.inf])),
        )
        command = CPair(wanted.acceleration_m_s2, wanted.compressor_power_w)
        changed = library.iptm_limit_command(
            ctypes.byref(limits), ctypes.byref(vehicle(state)), ctypes.byref(command)
        )
        expected, reasons = limiter.limit(wanted, state)
        assert (command.first, command.second) == (
            expected.acceleration_m_s2,
            expected.compressor_power_w,
        )
        assert changed == sum(bits[reason] for reason in reasons)
        seen |= changed
    assert seen == sum(bits.values())


def test_fallback_is_that_of_python(library: ctypes.CDLL) -> None:
    limits = ctypes.c_char.in_dll(library, "iptm_limits_of_model")
    rng = np.random.default_rng(2)
    for _ in range(3000):
        state = some_state(rng)
        leader = LeaderState(
            0.0, state.position_m + float(rng.uniform(-2.0, 80.0)), float(rng.uniform(0.0, 40.0))
        )
        following = library.iptm_safe_following(
            ctypes.byref(limits),
            ctypes.byref(vehicle(state)),
            ctypes.byref(CPair(leader.position_m, leader.speed_m_s)),
        )
        expected = safe_following(state, leader, PARAMETERS)
        assert following.first == pytest.approx(expected.acceleration_m_s2, abs=1e-12)
        assert following.second == expected.compressor_power_w
        stop = library.iptm_controlled_stop(ctypes.byref(limits), ctypes.byref(vehicle(state)))
        expected = controlled_stop(state, PARAMETERS, 1.0)
        assert (stop.first, stop.second) == (
            expected.acceleration_m_s2,
            expected.compressor_power_w,
        )


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_monitor_is_that_of_python(library: ctypes.CDLL, friction: float) -> None:
    """Decisions of both along random drives, with what brakes and road made of the requests."""
    settings = replace(
        SafetyMonitorSettings(),
        road_friction=friction,
        gap_accuracy_m=0.3,
        lead_speed_accuracy_m_s=0.2,
    )
    monitor = SafetyMonitor(settings, PARAMETERS.brakes)
    numbers = (DOUBLE * 8)(
        settings.monitor_reaction_s,
        settings.monitor_release_reaction_s,
        settings.monitor_hold_s,
        settings.monitor_margin_m,
        settings.gap_accuracy_m,
        settings.lead_speed_accuracy_m_s,
        PARAMETERS.brakes.delay_s,
        PARAMETERS.brakes.build_up_m_s3,
    )
    rng = np.random.default_rng(3)
    states = set()
    for _ in range(60):
        memory, in_c = MonitorMemory(), CMonitorMemory(brake_share=1.0)
        speed, gap, lead_speed = (
            rng.uniform(0.0, 30.0),
            rng.uniform(5.0, 60.0),
            rng.uniform(0.0, 30.0),
        )
        for step in range(80):
            time_s = 0.1 * step
            gap += 0.1 * (lead_speed - speed) + rng.normal(0.0, 0.5)
            speed = max(speed + rng.normal(0.0, 0.3), 0.0)
            lead_speed = max(lead_speed + rng.normal(-0.05, 0.5), 0.0)
            acceleration, unseen = rng.normal(0.0, 1.0), float(rng.choice([0.0, 0.2, 1.0]))
            road = monitor.road_braking(float(rng.normal(0.0, 0.03)), memory.road_m_s2)
            lead = LeaderState(time_s, gap, lead_speed) if rng.random() < 0.9 else None
            memory = monitor.judge(memory, time_s, (0.0, speed, acceleration), lead, road, unseen)
            slippery = road.full if road.slippery is None else road.slippery
            given = CRoad(
                CPair(road.full.own_m_s2, road.full.lead_m_s2),
                CPair(slippery.own_m_s2, slippery.lead_m_s2),
                road.slippery is not None,
            )
            library.iptm_monitor_judge(
                ctypes.byref(numbers),
                ctypes.byref(in_c),
                ctypes.byref((DOUBLE * 4)(time_s, 0.0, speed, acceleration)),
                INT(lead is not None),
                DOUBLE(gap),
                DOUBLE(lead_speed),
                ctypes.byref(given),
                DOUBLE(unseen),
            )
            requested = float(rng.choice([0.0, -0.2, -2.0, -6.0]))
            delivered = requested * float(rng.choice([1.0, 0.97, 0.8, 0.4, 0.02]))
            memory = with_delivery(memory, requested, delivered, speed, 0.1)
            library.iptm_monitor_learn(
                ctypes.byref(in_c), *map(DOUBLE, (requested, delivered, speed, 0.1))
            )
            assert (bool(in_c.braking), bool(in_c.gently) and bool(in_c.braking)) == (
                memory.braking,
                memory.gently and memory.braking,
            )
            for name in ("since_s", "brake_share", "followed_m_s2", "road_m_s2"):
                assert getattr(in_c, name) == getattr(memory, name)
            states.add((memory.braking, memory.gently))
    assert {(False, False), (True, False)} <= states
    assert friction or (True, True) in states

"""The controller in C on a Cortex-M7 under QEMU, and how well limiter and safety monitor are tested.

Needs CMake, GCC, gcov, Cppcheck, ``gcc-arm-none-eabi`` and ``qemu-system-arm``. Instructions are counted as
nanoseconds of virtual time (``-icount shift=0``).
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from studies.embedded.safeguards import (
    ADVISORY,
    EQUIVALENT,
    SOURCES,
    lines_covered,
    misra_findings,
    survivors,
    write_sources,
)
from studies.session import Session

from iptm_core.errors import StoreError
from iptm_core.markdown import table_of
from iptm_core.state import FloatArray
from iptm_ecu.codegen import write_controller

MEASURES_TIME = True
"""Counts of a compiler rather than numbers of the suite alone."""
TICKS, SHORT_TICKS = 10_000.0, 20.0
CLOCK_HZ, BAR_S = 480e6, 0.1
CYCLES_PER_INSTRUCTION = 3.0
CLOSE_M_S2 = 1e-4
HERE = Path(__file__).parent
TOOLCHAIN = HERE / "cortex_m7.cmake"
TOOLS = ("cmake", "gcc", "gcov", "cppcheck", "arm-none-eabi-gcc", "qemu-system-arm")
QEMU = "qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -icount shift=0".split()  # noqa: SIM905
DOUBLE, SINGLE, COARSE = "double", "single", "double, stops at 10⁻⁴"
HOST, TARGET = "this computer", "Cortex-M7"
BUILDS = ((HOST, DOUBLE), (HOST, SINGLE), (HOST, COARSE), (TARGET, DOUBLE), (TARGET, SINGLE))
COLUMNS = {
    "computer": "{computer}",
    "solver": "{precision}",
    "ticks:": "{ticks}",
    "median difference (m/s²):": "{median_m_s2:.1g}",
    "largest (m/s²):": "{largest_m_s2:.2g}",
    "largest (W):": "{largest_w:.2g}",
    "within 10⁻⁴ m/s²:": "{close:.1f} %",
    "other rungs:": "{rungs}",
    "iterations, mean:": "{iterations:.2f}",
    "cost of the plans:": "{cost:+.3f} %",
}
COUNTS = {
    "solver": "{precision}",
    "instructions, median (10⁶):": "{median:.2f}",
    "p99 (10⁶):": "{p99:.2f}",
    "largest (10⁶):": "{largest:.2f}",
    f"p99 at {CYCLES_PER_INSTRUCTION:g} cycles each:": "{p99_ms:.0f} ms",
    "largest:": "{largest_ms:.0f} ms",
    "cycles each up to which p99 is 100 ms:": "{bound:.1f}",
    "flash:": "{flash_kb:.0f} kB",
    "RAM, kept and shared:": "{memory_kb:.1f} kB",
    "stack:": "{stack_kb:.1f} kB",
}
TESTED = {
    "source": "`{source}`",
    "lines that the cases reach:": "{covered}",
    "mutants:": "{mutants}",
    "killed:": "{killed}",
    "of those that are not equivalent:": "{share:.1f} %",
}


def called(*command: str | Path, most: int = 0) -> str:
    """Run a tool and return what it prints; an exit code above `most` is an error."""
    done = subprocess.run(  # noqa: S603
        [*map(str, command)], check=False, capture_output=True, text=True, timeout=3000
    )
    if not 0 <= done.returncode <= most:
        raise StoreError(f"{command[0]} ends with {done.returncode}: {done.stderr[-500:]}")
    return done.stdout + done.stderr


def build(folder: Path, computer: str, precision: str) -> Path:
    """Build controller and bench with CMake; returns the folder of the build."""
    place = folder / f"build_{BUILDS.index((computer, precision))}"
    options = [f"-DIPTM_FLOAT={'ON' if precision == SINGLE else 'OFF'}"]
    options += [f"-DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN}"] if computer == TARGET else []
    options += ["-DCMAKE_C_FLAGS=-DIPTM_LEAST_TOLERANCE=1e-4"] if precision == COARSE else []
    called("cmake", "-S", folder, "-B", place, *options)
    called("cmake", "--build", place)
    return place


def drive(folder: Path, place: Path, *, target: bool) -> tuple[FloatArray, str]:
    """Drive a controller through the recorded ticks; returns a row per tick and what the bench prints."""
    ticks, decisions = folder / "ticks.bin", place / "decisions.txt"
    if target:
        given = ",".join(f"arg={each}" for each in ("bench", ticks, decisions))
        semihosting = ("-semihosting-config", f"enable=on,target=native,{given}")
        printed = called(*QEMU, *semihosting, "-kernel", place / "bench", most=1)
    else:
        printed = called(place / "bench", ticks, decisions, most=1)
    return np.loadtxt(decisions, ndmin=2), printed


def flash_bytes(place: Path) -> int:
    """Return the size of controller and monitor with what they need of the C library."""
    flags = "-mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard -nostartfiles -Wl,--gc-sections"
    roots = "-Wl,-e,iptm_decide -Wl,-u,iptm_monitor_judge -Wl,-u,iptm_monitor_learn"
    linked = place / "flash.elf"
    called(
        "arm-none-eabi-gcc",
        *flags.split(),
        *roots.split(),
        place / "libiptm_controller.a",
        "-lm",
        "-o",
        linked,
    )
    text, data = called("arm-none-eabi-size", linked).splitlines()[1].split()[:2]
    return int(text) + int(data)


def commands_of(
    folder: Path, computer: str, precision: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Build and drive one of `BUILDS`; returns its rows of the tables."""
    place, target = build(folder, computer, precision), computer == TARGET
    rows, printed = drive(folder, place, target=target)
    off_m_s2, off_w, rungs, iterations, costs, count = rows.T
    off_m_s2, off_w = np.abs(off_m_s2), np.abs(off_w)
    row = {
        "computer": computer,
        "precision": precision,
        "ticks": len(rows),
        "median_m_s2": np.median(off_m_s2),
        "largest_m_s2": off_m_s2.max(),
        "largest_w": off_w.max(),
        "close": 100.0 * np.mean(off_m_s2 <= CLOSE_M_S2),
        "rungs": int(np.count_nonzero(rungs)),
        "iterations": iterations.mean(),
        "cost": costs.sum(),
    }
    if not target:
        return row, {}
    median, p99, largest = np.quantile(count, [0.5, 0.99, 1.0])
    per_ms = CLOCK_HZ / CYCLES_PER_INSTRUCTION / 1000.0
    sizes = re.findall(r"(?:memory|scratch|stack) (\d+) bytes", printed)
    memory, scratch, stack = map(int, sizes)
    return row, {
        "precision": precision,
        "median": median / 1e6,
        "p99": p99 / 1e6,
        "largest": largest / 1e6,
        "p99_ms": p99 / per_ms,
        "largest_ms": largest / per_ms,
        "bound": CLOCK_HZ * BAR_S / p99,
        "flash_kb": flash_bytes(place) / 1000.0,
        "memory_kb": (memory + scratch) / 1000.0,
        "stack_kb": stack / 1000.0,
    }


def tested(folder: Path, source: str, covered: str) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """Return how thoroughly a source is tested, and the mutants that no case kills."""
    count, left = survivors(folder, source)
    reasons = [
        next((why for what, why in EQUIVALENT.items() if what in mutant.change), "")
        for mutant in left
    ]
    equivalent = sum(map(bool, reasons))
    row = {
        "source": source,
        "covered": covered,
        "mutants": count,
        "killed": count - len(left),
        "share": 100.0 * (count - len(left)) / (count - equivalent),
    }
    rows = [
        {"source": source, "change": mutant.change, "why": why or "**not killed**"}
        for mutant, why in zip(left, reasons, strict=True)
    ]
    return row, rows


def run(session: Session) -> bool:
    """Run the study; returns whether the bars are held."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        packages = "cmake, gcc, cppcheck, gcc-arm-none-eabi, qemu-system-arm"
        raise StoreError(f"not installed: {', '.join(missing)}; needed of Debian: {packages}")
    folder, parts = session.scratch / "ecu", session.scratch / "parts"
    ticks = SHORT_TICKS if session.short else TICKS
    shutil.rmtree(folder, ignore_errors=True)
    write_controller(
        folder,
        strategy=None,
        horizon=None,
        parameter_set=None,
        cycle="comprehensive",
        duration_s=ticks,
    )
    found = []
    for computer, precision in BUILDS:
        if computer == TARGET:
            shutil.copy(HERE / "cortex_m7.c", folder)
        found.append(commands_of(folder, computer, precision))
    least = found[0][0]["cost"]
    for row, _ in found:
        row["cost"] = 100.0 * (row["cost"] / least - 1.0)
    parts.mkdir(exist_ok=True)
    write_sources(parts)
    covered = lines_covered(parts)
    checks = [tested(parts, source, covered[source]) for source in SOURCES]
    findings = misra_findings(parts)
    required = {rule: count for rule, count in findings.items() if rule not in ADVISORY}
    counts = [count for _, count in found if count]
    session.fill(
        {
            "commands": table_of([row for row, _ in found], COLUMNS),
            "instructions": table_of(counts, COUNTS),
            "tests": table_of([row for row, _ in checks], TESTED),
            "survivors": table_of(
                [row for _, rows in checks for row in rows],
                {"source": "`{source}`", "change": "{change}", "why it does the same": "{why}"},
            ),
            "findings": f"Open findings of the required class: {sum(required.values())}"
            f" ({sum(findings.values())} of the advisory class, of the rules {', '.join(sorted(findings))}).",
        }
    )
    bars = [count["p99_ms"] <= 1000.0 * BAR_S for count in counts]
    return all(bars) and not required and all(row["share"] >= 95.0 for row, _ in checks)

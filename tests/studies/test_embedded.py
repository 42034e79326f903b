"""Limiter and monitor in C against Python, their mutants, and the controller on a Cortex-M7 under QEMU."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from studies.embedded.run import DOUBLE, HERE, TARGET, commands_of
from studies.embedded.safeguard_cases import BITS, all_cases
from studies.embedded.safeguards import (
    ADVISORY,
    SOURCES,
    built,
    is_killed,
    lines_covered,
    misra_findings,
    mutants,
    write_sources,
)

from iptm_ecu.codegen import write_controller


def need(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"no {program} on this machine")


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sources")
    write_sources(folder)
    return folder


def test_limiter_and_monitor_are_those_of_python(sources: Path) -> None:
    need("cc")
    library, cases = built(sources, "sound.so"), all_cases()
    assert all(case.holds(library) for case in cases)
    bits = {int(case.returned or 0) for case in cases if case.function == "iptm_limit_command"}
    assert all(any(found & bit for found in bits) for bit in BITS.values())
    decided = [case.expected[:2] for case in cases if case.function == "iptm_monitor_judge"]
    assert all([braking, gently] in decided for braking, gently in ((0, 0), (1, 0), (1, 1)))


def test_a_mutant_is_killed(sources: Path) -> None:
    need("cc")
    source, place = SOURCES[1], 30
    text = (sources / source).read_text()
    mutant = list(mutants(source, text))[place]
    assert is_killed(sources, mutant, text, all_cases(), f"mutant_{place}.so"), mutant.change
    assert (sources / source).read_text() == text


def test_every_line_is_reached(sources: Path) -> None:
    need("gcc", "gcov")
    covered = lines_covered(sources)
    assert all(covered[source].startswith("100.00%") for source in SOURCES)


def test_no_required_rule_of_misra_is_broken(sources: Path) -> None:
    need("cppcheck")
    findings = misra_findings(sources)
    assert findings, "the add-on found nothing at all, not even of the advisory class"
    assert not {*findings} - ADVISORY
    # Whether it would be found: a number as a condition breaks rule 14.4.
    worse = sources / "worse"
    shutil.copytree(sources, worse)
    text = (
        (worse / SOURCES[0]).read_text().replace("  command->acc", "  if (changed) command->acc", 1)
    )
    (worse / SOURCES[0]).write_text(text)
    assert "14.4" in misra_findings(worse)


def test_ticks_on_a_target(tmp_path: Path) -> None:
    """In double precision; the short form of the study drives single precision."""
    need("cmake", "arm-none-eabi-gcc", "qemu-system-arm")
    write_controller(
        tmp_path / "ecu",
        strategy=None,
        horizon=None,
        parameter_set=None,
        cycle="wltc_class3b",
        duration_s=5.0,
    )
    shutil.copy(HERE / "cortex_m7.c", tmp_path / "ecu")
    row, counts = commands_of(tmp_path / "ecu", TARGET, DOUBLE)
    assert row["ticks"] == 5
    assert row["rungs"] == 0
    assert row["largest_m_s2"] < 1e-6
    assert 0.2 < counts["median"] < counts["largest"] < 10.0
    assert counts["bound"] > 3.0
    assert 100.0 < counts["flash_kb"] < 250.0

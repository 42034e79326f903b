"""The planted faults fit the code as it is, and a fault makes a test fail where the sound code passes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from studies.safety.mutations import ROOT, drawn_faults, planted_faults


def test_each_planted_fault_changes_the_code_that_there_is() -> None:
    faults = list(planted_faults())
    assert len(faults) >= 60
    for fault in faults:
        assert fault.old in fault.source.read_text(encoding="utf-8"), fault.describe()
        assert all((ROOT / test).is_file() for test in fault.tests), fault.describe()


def test_a_fault_is_caught_and_its_absence_is_not() -> None:
    fault = next(fault for fault in planted_faults() if "ahead_s" in fault.old)
    assert fault.is_caught()
    assert not replace(fault, new=fault.old).is_caught()


def test_faults_are_drawn_from_constants_and_comparisons_of_both_languages() -> None:
    faults = drawn_faults(60, seed=2)
    assert faults == drawn_faults(60, seed=2) != drawn_faults(60, seed=3)
    assert {Path(fault.file).suffix for fault in faults} == {".py", ".c"}
    for fault in faults:
        text = fault.source.read_text(encoding="utf-8")
        changed = fault.planted(text)
        assert changed.count("\n") == text.count("\n")
        assert changed != text

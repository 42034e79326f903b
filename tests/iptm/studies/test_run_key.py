"""The key of a run: everything that its numbers depend on, and nothing else."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from iptm.studies import study
from iptm.studies.run_spec import RunKind, RunSpec
from iptm.studies.study import code_fingerprint, normalised_source, planned_run, source_files
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import DEFAULT_SET

BASE = RunSpec(cycle="us06", duration_s=60.0)


def key_of(spec: RunSpec) -> str:
    return planned_run(spec).key


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": RunKind.WHOLE_TRIP},
        {"cycle": "nycc"},
        {"slope": "small"},
        {"duration_s": 61.0},
        {"parameter_set": "textbook_cell"},
        {"overrides": (("body.mass_kg", 1432.0000000000002),)},
        {"strategy": replace(STRATEGIES["aging"], aging_weight=1.0000000000000002e9)},
        {"aging_law": "nca"},
        {"horizon": "16x1"},
        {"tolerance": 2e-5},
        {"seed": 1, "noise_std_m_s": 1.0},
        {"preview_length_s": 61.0},
        {"tick_s": 0.5},
        {"plant_step_s": 0.1},
    ],
)
def test_every_number_counts(changes: dict[str, Any]) -> None:
    assert key_of(replace(BASE, **changes)) != key_of(BASE)


@pytest.mark.parametrize(
    "changes",
    [
        {"strategy": replace(STRATEGIES["aging"], name="proposed")},
        {"overrides": (("body.mass_kg", 1432.0),)},  # equal to the value of the set
        {"horizon": "15x1.0"},
        {"preview_length_s": 60.0},  # what the horizon asks for anyway
    ],
)
def test_names_do_not_count(changes: dict[str, Any]) -> None:
    assert key_of(replace(BASE, **changes)) == key_of(BASE)


def test_a_set_counts_with_its_values(tmp_path: Path) -> None:
    """Another chiller set leaves the runs of the default set alone, and a copy gives the same key."""
    copy = tmp_path / "copy.yaml"
    copy.write_text(f"base: {DEFAULT_SET}\n", encoding="utf-8")
    assert key_of(replace(BASE, parameter_set=str(copy))) == key_of(BASE)
    other = tmp_path / "other.yaml"
    other.write_text(
        f"base: {DEFAULT_SET}\n"
        "chiller: {gate_power_w: {value: 501, unit: W, source: chosen}}\n",
        encoding="utf-8",
    )
    assert key_of(replace(BASE, parameter_set=str(other))) != key_of(BASE)


def test_a_cycle_file_counts_with_its_content(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    rows = [(0, 0.0), (1, 1.0), (2, 2.0), (3, 0.0)]

    def key_of_rows() -> str:
        path.write_text(
            "time_s,speed_m_s\n" + "".join(f"{t},{v}\n" for t, v in rows), encoding="utf-8"
        )
        study._route.cache_clear()
        return key_of(RunSpec(cycle=str(path)))

    first = key_of_rows()
    assert key_of_rows() == first
    rows[2] = (2, 2.5)
    assert key_of_rows() != first


def test_code_and_libraries_count(monkeypatch: pytest.MonkeyPatch) -> None:
    before = key_of(BASE)
    monkeypatch.setattr(study, "installed_version", lambda _: "0")
    code_fingerprint.cache_clear()
    try:
        assert key_of(BASE) != before
    finally:
        code_fingerprint.cache_clear()


def test_comments_and_docstrings_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    code = 'X = 1\n\ndef double(x):\n    """Twice."""\n    return 2 * x\n'
    path.write_text(code, encoding="utf-8")
    meaning = normalised_source(path)
    path.write_text(
        '"""New."""\n# a comment\nX = 1\n"""About X."""\ndef double(x):\n'
        '    """Two times."""\n    return 2*x  # same\n',
        encoding="utf-8",
    )
    assert normalised_source(path) == meaning
    path.write_text(code.replace("2 * x", "3 * x"), encoding="utf-8")
    assert normalised_source(path) != meaning


def test_fingerprint_covers_the_numbers_and_not_the_nodes() -> None:
    names = set(source_files())
    assert {
        "iptm_core/physics/cell.py",
        "iptm_core/routes/cycles.py",
        "iptm_plant_sim/plant.py",
        "iptm_v2x_bridge/bridge.py",
        "iptm_controller/ocp/stage.py",
        "iptm_controller/solvers/factory.py",
        "iptm/closed_loop.py",
        "iptm/studies/run.py",
        "iptm/whole_trip.py",
    } <= names
    assert not [name for name in names if "/node" in name or "/metrics/" in name]


def test_unreadable_source_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "broken.py"
    path.write_text("def (", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"broken\.py cannot be read"):
        normalised_source(path)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"cycle": "moon"}, "unknown driving cycle 'moon'"),
        ({"parameter_set": "textbok_cell"}, "did you mean 'textbook_cell'"),
        ({"overrides": (("gap.max_gap", 80.0),)}, "unknown parameter 'gap.max_gap'"),
        ({"duration_s": 10.5}, "whole number of ticks"),
    ],
)
def test_unusable_inputs_are_refused(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(IptmError, match=complaint):
        planned_run(replace(BASE, **changes))

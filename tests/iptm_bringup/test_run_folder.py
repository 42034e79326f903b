"""The folder of a run comes about whoever creates it first, and never replaces another."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_bringup.run_folder import RunFolder, default_output
from iptm_core.errors import ScenarioError


def test_logs_move_in_with_the_recorder(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "new" / "run")
    with folder.log_path("plant").open("w") as log:
        log.write("before\n")
        folder.output.mkdir()  # as the recorder does
        folder.settle()
        log.write("after\n")
    folder.settle()
    assert folder.logs == folder.output / "logs"
    assert (folder.output / "logs" / "plant.log").read_text() == "before\nafter\n"
    assert [path.name for path in folder.output.parent.iterdir()] == ["run"]


def test_without_a_recorder_the_folder_is_made(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.write_log("plant_parameters.yaml", "text")
    folder.settle()
    assert (tmp_path / "run" / "logs" / "plant_parameters.yaml").read_text() == "text"
    assert (tmp_path / "run" / "logs").stat().st_mode == (tmp_path / "run").stat().st_mode


def test_nothing_is_overwritten_and_nothing_left_behind(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(ScenarioError, match="exists already"):
        RunFolder(tmp_path / "run")
    (tmp_path / "file").write_text("")
    with pytest.raises(ScenarioError, match="cannot write"):
        RunFolder(tmp_path / "file" / "run")
    folder = RunFolder(tmp_path / "other")
    folder.output.mkdir()
    folder.discard()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "run"]


def test_runs_land_under_bags(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IPTM_ROOT", str(tmp_path))
    assert default_output("wltc").parent == tmp_path / "bags"
    assert default_output("wltc").name.startswith("wltc_2")


def test_a_name_too_long_for_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="has 300 bytes; allowed: up to 200"):
        RunFolder(tmp_path / ("x" * 300))
    with pytest.raises(ScenarioError, match="cannot write to"):
        RunFolder(tmp_path / ("x" * 300) / "run")

"""The folder of a run is created by one process and never replaces another."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from iptm.runner.run_folder import RunFolder, default_output
from iptm_core.errors import ScenarioError


def test_it_holds_the_logs(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "new" / "run")
    folder.write_log("plant_parameters.yaml", "text")
    assert (tmp_path / "new" / "run" / "logs" / "plant_parameters.yaml").read_text() == "text"
    assert [path.name for path in folder.output.parent.iterdir()] == ["run"]


def test_nothing_is_overwritten_and_nothing_left_behind(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(ScenarioError, match="exists already"):
        RunFolder(tmp_path / "run")
    (tmp_path / "file").write_text("")
    with pytest.raises(ScenarioError, match="cannot write"):
        RunFolder(tmp_path / "file" / "run")
    RunFolder(tmp_path / "other").discard()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "run"]


def test_one_of_many_gets_a_folder(tmp_path: Path) -> None:
    """Before, the others passed a check for existence, too, and deleted the folder when they failed."""

    def create(_: int) -> str:
        try:
            return RunFolder(tmp_path / "run").output.name
        except ScenarioError as error:
            return str(error)

    with ThreadPoolExecutor(16) as pool:
        found = list(pool.map(create, range(64)))
    assert found.count("run") == 1
    assert sum("exists already" in text for text in found) == 63
    assert (tmp_path / "run" / "logs").is_dir()


def test_runs_of_the_same_second_land_side_by_side_under_bags(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("IPTM_ROOT", str(tmp_path))
    assert default_output("wltc").parent == tmp_path / "bags"
    assert default_output("wltc").name.startswith("wltc_2")
    wanted = tmp_path / "bags" / "wltc_20260101_120000"
    names = [RunFolder(wanted, numbered=True).output.name for _ in range(3)]
    assert names == [wanted.name, f"{wanted.name}_2", f"{wanted.name}_3"]


def test_a_name_too_long_for_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="has 300 bytes; allowed: up to 200"):
        RunFolder(tmp_path / ("x" * 300))
    with pytest.raises(ScenarioError, match="cannot write to"):
        RunFolder(tmp_path / ("x" * 300) / "run")

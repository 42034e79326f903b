"""Installed executables say in one line which library is missing."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import pytest

from iptm_core import program


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for the module `made_up`, which the executable `plant` is to run."""
    entry = EntryPoint("plant", "made_up:main", program.PROGRAMS)

    def entry_points(**wanted: Any) -> EntryPoints:
        return EntryPoints([entry]).select(**wanted)

    monkeypatch.setattr(program, "entry_points", entry_points)
    monkeypatch.setattr(sys, "argv", ["/install/iptm_plant_sim/lib/iptm_plant_sim/plant", "-x"])
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "made_up", raising=False)
    return tmp_path


def test_runs_the_program_of_its_name(installed: Path) -> None:
    (installed / "made_up.py").write_text("def main():\n    return 7\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 7


def test_a_missing_library_is_one_line(installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (installed / "made_up.py").write_text("import not_installed_here\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("plant: No module named 'not_installed_here'")
    assert "requirements/run-no-ros.txt" in line

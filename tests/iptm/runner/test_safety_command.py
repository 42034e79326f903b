"""The command of the safety trials: every part in its short version, once."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm.runner.safety_trials import PAGE, main


def test_the_short_version_drives_every_part_and_goes_on_from_what_is_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--short", "--store", str(tmp_path), "--workers", "1"]
    assert main(arguments) in (0, 1)
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    for heading in ("brakes", "trials", "ROS 2", "events", "commands", "hold"):
        assert any(heading in line for line in page.splitlines() if line.startswith("## "))
    assert "| nycc | 4 |" in page
    assert "avoidable collision" not in page
    capsys.readouterr()
    main(arguments)
    output = capsys.readouterr().err
    assert "0 runs computed" in output
    assert "braking lead vehicle" not in output
    assert (tmp_path / PAGE).read_text(encoding="utf-8") == page
    main([*arguments, "--stored"])
    stored = (tmp_path / PAGE).read_text(encoding="utf-8")
    assert stored.splitlines()[6:] == page.splitlines()[6:]


def test_a_missing_folder_of_measured_drives_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--short", "--store", str(tmp_path), "--measured", str(tmp_path / "nowhere")]
    assert main(arguments) == 2
    assert "nowhere" in capsys.readouterr().err

"""The command `drive`: a recorded drive in words and as a picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_drives.commands import drive as main

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "phone_drive.gpx"
BAG = ROOT / "bags" / "example_us06_120s"


def test_a_drive_is_described_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "drive.png"
    assert main(["show", str(EXAMPLE), "--picture", str(picture)]) == 0
    output = capsys.readouterr().out
    assert "600 s" in output
    assert "601 points" in output
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_bag_is_a_drive(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(BAG)]) == 0
    assert "example_us06_120s: 120 s" in capsys.readouterr().out


def test_a_file_that_is_no_drive_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["show", str(tmp_path / "none.gpx")]) == 2
    assert "no such file" in capsys.readouterr().err

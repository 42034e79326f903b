"""The command that compares bags by figures or message by message."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from iptm.commands.tree import main
from iptm_bags.reading import compare

BAG = Path(__file__).resolve().parents[3] / "bags" / "example_us06_120s"


def test_bags_are_compared_by_figures_or_message_by_message(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    assert main(["compare", str(BAG), str(BAG)]) == 0
    assert "the settings do not differ" in capsys.readouterr().out
    assert main(["compare", "--exact", str(BAG), str(BAG)]) == 0
    assert "/plant/state" in capsys.readouterr().out
    assert main(["compare", str(BAG), str(BAG), "--absolute", "1"]) == 2
    assert "without --exact" in capsys.readouterr().err


def test_the_command_prints_draws_and_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, page = tmp_path / "both.png", tmp_path / "both.html"
    files = ["--picture", str(picture), "--report", str(page)]
    assert compare([str(BAG), str(BAG), *files]) == 0
    out = capsys.readouterr().out
    assert "energy: 0.0 % saved" in out
    assert "Battery energy per distance [kWh/100 km]" in out
    assert "the settings do not differ" in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    for arguments, message in (
        ([str(BAG)], "compare: 1 runs; allowed: two or more"),
        ([str(BAG), "/no/such/bag"], "does not exist"),
        ([str(BAG), str(BAG), *files], "both.png exists already; allowed: a new file"),
        (
            [str(BAG), str(BAG), "--picture", str(tmp_path / "both.xyz")],
            "picture cannot be written",
        ),
        ([str(BAG), str(BAG), "--report", "/no/such/folder/x.html"], "No such file or directory"),
    ):
        assert compare(arguments) == 2
        assert message in capsys.readouterr().err

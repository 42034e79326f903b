"""The measurements on the smallest input that makes sense; speed is not tested."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from benchmarks import ros_speed, speed
from benchmarks.harness import run_benchmark

from iptm_controller.controller import Controller


def test_shares_of_the_loop_add_up_and_the_page_gets_its_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page, numbers = tmp_path / "page.md", tmp_path / "numbers.json"
    page.write_text("before\n<!-- speed -->\n\nold\n\n<!-- end of speed -->\n")
    monkeypatch.setattr(speed, "GRIDS", {"2x1+1x5": "aging"})
    original = Controller.decide
    options = ["--cycle", "nycc", "--duration-s", "8", "--ros", "0", "--page", "1"]
    arguments = [*options, "--json", str(numbers)]
    assert run_benchmark(speed.measure, arguments, speed.tables, page) == 0
    assert Controller.decide is original
    (row,) = json.loads(numbers.read_text())["headless"]
    assert row["ticks"] == sum(row["statuses"].values()) == 8
    assert sum(row["share"].values()) == pytest.approx(1.0)
    (line,) = [line for line in page.read_text().splitlines() if line.startswith("| nycc")]
    assert line in capsys.readouterr().out
    assert "old" not in page.read_text()


@pytest.mark.integration
@pytest.mark.slow
def test_cases_over_ros_are_compared_with_the_first() -> None:
    first, second = ros_speed.measure("demo", 10.0)
    assert [first["case"], second["case"]] == ["recorded", "not recorded"]
    assert first["wall_ratio"] == 1.0
    assert first["good"]
    assert second["good"]
    assert sum(second["statuses"].values()) >= 10


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["--case", "fast"], "fast"), (["--case", "other checkout", "--other", "/"], "set up")],
)
def test_a_mistake_is_refused(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_benchmark(ros_speed.measure, arguments) == 2
    assert named in capsys.readouterr().err

"""Two bags of trips over ROS 2, judged by one command, have the judgement of the trips in memory."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

import iptm

main = import_module("iptm_judges.cli").main


def test_the_command_judges_two_bags_as_the_trips_in_memory(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("blast")
    trip = iptm.Trip.of("us06", duration_s=120.0, preview_mode="none")
    bags, files = [], []
    for name in ("aging_cost_to_go", "production"):
        each = trip.against(name)
        bags.append(str(tmp_path / name))
        assert not iptm.drive(each, over="ros", bag=bags[-1]).problems
        files.append(str(iptm.drive(each).save(tmp_path / f"{name}.npz")))
    printed = []
    capfd.readouterr()
    for place, runs in enumerate((bags, files)):
        # Nothing is taken from the other one.
        monkeypatch.setattr("iptm_judges.cli.cache_directory", lambda to=place: tmp_path / str(to))
        assert main([*runs, "--by", "paper", "cells", "blast"]) == 0
        printed.append(capfd.readouterr().out)
    assert "laws of cells: " in printed[0]
    assert printed[0] == printed[1]

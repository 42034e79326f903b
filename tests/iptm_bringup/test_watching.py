"""A run that is watched: its pace, and the reference car of the live view."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest

from iptm_bringup import reference_drive
from iptm_bringup.comparison import drive_other
from iptm_bringup.run_closed_loop import WATCHING_RATE, build_parser, prepared_from
from iptm_bringup.scenario import Scenario, prepare
from iptm_core.settings import LoopMode


@pytest.mark.parametrize(
    ("options", "mode", "rate_factor"),
    [
        (["demo"], LoopMode.LOCK_STEP, 1.0),
        (["demo", "--view"], LoopMode.REAL_TIME, WATCHING_RATE),
        (["demo", "--view", "--rate-factor", "3"], LoopMode.REAL_TIME, 3.0),
        (["demo", "--view", "--mode", "lock_step"], LoopMode.LOCK_STEP, 1.0),
        (["real_time", "--view"], LoopMode.REAL_TIME, 1.0),
    ],
)
def test_who_watches_gets_a_pace_that_can_be_watched(
    options: list[str], mode: LoopMode, rate_factor: float
) -> None:
    scenario = prepared_from(build_parser().parse_args(options)).scenario
    assert (scenario.mode, scenario.rate_factor) == (mode, rate_factor)


def test_the_reference_car_drives_the_same_trip(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycc\nduration_s: 20.0\n"))
    assert reference_drive.main(["--strategy", "reference"]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    run = drive_other(prepare(Scenario(cycle="nycc", duration_s=20.0)), "reference").trajectory
    assert told["time_s"] == run.time_s.tolist()
    np.testing.assert_array_equal(
        told["capacity_loss"], run.cell_1_capacity_loss + run.cell_n_capacity_loss
    )


def test_a_trip_that_cannot_be_driven_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycd\n"))
    assert reference_drive.main([]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "nycd" in line

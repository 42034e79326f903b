"""The trip of the reference car: the same as the run's, driven once."""

from __future__ import annotations

import io
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from iptm.driving import drive_in_memory
from iptm.runner.run_folder import REFERENCE
from iptm.trip import Trip
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.recording.trajectory_file import export_table, write_parquet
from iptm_view import reference_drive


def test_the_reference_car_drives_the_same_trip(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycc\nduration_s: 20.0\n"))
    assert reference_drive.main(["--strategy", "reference"]) == 0
    header, *rows = map(json.loads, capsys.readouterr().out.splitlines())
    assert (header["strategy"], header["duration_s"]) == ("reference", 20.0)
    columns: dict[str, Any] = dict(zip(header["columns"], np.transpose(rows), strict=True))
    run = drive_in_memory(Trip.of("nycc", duration_s=20.0).against("reference")).trajectory
    expected = {
        **{name: getattr(run, name) for name in columns if hasattr(run, name)},
        "cell_1_temperature_c": run.cell_1_temperature_k - CELSIUS_ZERO_K,
        "cell_n_temperature_c": run.cell_n_temperature_k - CELSIUS_ZERO_K,
        "capacity_loss": run.cell_1_capacity_loss + run.cell_n_capacity_loss,
    }
    assert expected.keys() == columns.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(columns[name], values, err_msg=name)


def test_a_run_that_keeps_its_reference_has_it_driven_no_second_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycc\nduration_s: 20.0\n"))
    run = drive_in_memory(Trip.of("nycc", duration_s=20.0).against("reference")).trajectory
    table = export_table(run.to_arrays(), {"strategy": "reference"})
    write_parquet(tmp_path / REFERENCE, table)
    driven: list[str] = []
    monkeypatch.setattr(reference_drive, "drive_in_memory", partial(_note_strategy, driven))
    assert reference_drive.main([f"--run={tmp_path}"]) == 0
    header, *rows = map(json.loads, capsys.readouterr().out.splitlines())
    columns: dict[str, Any] = dict(zip(header["columns"], np.transpose(rows), strict=True))
    for name in ("time_s", "position_m", "battery_power_w"):
        assert columns[name].tolist() == getattr(run, name).tolist()
    assert driven == []
    # Of another strategy, or with a damaged file, it is driven.
    for strategy in ("aging", "reference"):
        monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycc\nduration_s: 20.0\n"))
        assert reference_drive.main([f"--run={tmp_path}", f"--strategy={strategy}"]) == 0
        (tmp_path / REFERENCE).write_bytes(b"PAR1 damaged")
    assert driven == ["aging", "reference"]


def _note_strategy(driven: list[str], trip: Trip, on_step: object) -> None:  # noqa: ARG001
    driven.append(trip.controller.strategy)


def test_a_trip_that_cannot_be_driven_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("cycle: nycd\n"))
    assert reference_drive.main([]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "nycd" in line

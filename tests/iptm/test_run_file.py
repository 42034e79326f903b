"""A saved run comes back as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import iptm

SHORT = {"duration_s": 20.0, "horizon": "3x1"}


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    return iptm.simulate("us06", slope="large", overrides={"body.mass_kg": 1600.0}, **SHORT)


def test_saving_and_loading_are_inverse(run: iptm.Run, tmp_path: Path) -> None:
    again = iptm.load(run.save(tmp_path / "run.npz"))
    for table in ("trajectory", "decisions"):
        own, other = getattr(run, table).to_arrays(), getattr(again, table).to_arrays()
        for name, column in own.items():
            np.testing.assert_array_equal(column, other[name], err_msg=name)
            assert column.dtype == other[name].dtype
    assert again.parameters == run.parameters
    assert again.trip == run.trip
    assert (again.name, again.wall_time_s) == (run.name, run.wall_time_s)
    assert again.slope is not None
    assert run.slope is not None
    np.testing.assert_array_equal(again.slope.slopes_rad, run.slope.slopes_rad)
    assert again.summary.equals(run.summary)
    assert iptm.compare(run, again).differences.empty


def test_a_drive_of_data_is_loaded_without_its_trip(tmp_path: Path) -> None:
    drive = (np.arange(30.0), np.linspace(0.0, 14.5, 30))
    run = iptm.simulate(drive, **SHORT)
    again = iptm.load(run.save(tmp_path / "own.npz"))
    assert again.trip is None
    assert again.summary.equals(run.summary)


def test_a_file_of_an_earlier_version_is_read(run: iptm.Run, tmp_path: Path) -> None:
    with np.load(run.save(tmp_path / "run.npz")) as file:
        stored = dict(file)
    del stored["trajectory.command_source"]
    np.savez(tmp_path / "earlier.npz", **stored)
    again = iptm.load(tmp_path / "earlier.npz")
    assert np.isnan(again.trajectory.command_source).all()
    assert again.figures == run.figures


def test_mistakes_are_one_line(run: iptm.Run, tmp_path: Path) -> None:
    file = run.save(tmp_path / "run.npz")
    with pytest.raises(iptm.IptmError, match="exists already"):
        run.save(file)
    with pytest.raises(iptm.IptmError, match=r"ends in \.npz"):
        run.save(tmp_path / "run.csv")
    (tmp_path / "cut.npz").write_bytes(file.read_bytes()[:500])
    np.savez(tmp_path / "other.npz", x=np.arange(3))
    for name in ("cut.npz", "other.npz", "missing.npz"):
        with pytest.raises(iptm.IptmError, match=r"holds no run of Run\.save"):
            iptm.load(tmp_path / name)

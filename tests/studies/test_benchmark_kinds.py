"""Entrants from files: one law in Python, C and as an FMU drives the same trip; bags; refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.__main__ import main
from studies.benchmark.driving import Driven, drive
from studies.benchmark.kinds import FOLLOWER, unit_in

import iptm

SAME = 1e-6
PYTHON = f"{FOLLOWER / 'follower.py'}:Follower"
BAG = Path(__file__).parents[2] / "bags" / "example_us06_120s"


@pytest.fixture(scope="module")
def trip() -> iptm.Trip:
    return iptm.Trip.of("us06", duration_s=60.0, slope="small", climate=35.0)


@pytest.fixture(scope="module")
def driven(trip: iptm.Trip) -> Driven:
    found = drive(trip, PYTHON)
    assert found is not None
    # It follows and cools.
    assert found.rows["speed_m_s"].max() > 15.0
    assert found.rows["cell_n_temperature_k"].min() > 300.0
    return found


def assert_same(found: Driven | None, driven: Driven) -> None:
    assert found is not None
    for name, values in driven.rows.items():
        np.testing.assert_allclose(found.rows[name], values, rtol=SAME, atol=SAME, err_msg=name)


def test_a_law_in_c_drives_as_in_python(trip: iptm.Trip, driven: Driven) -> None:
    assert_same(drive(trip, str(FOLLOWER / "follower.c")), driven)


def test_a_law_as_an_fmu_drives_as_in_python(
    trip: iptm.Trip, driven: Driven, tmp_path: Path
) -> None:
    pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
    unit = unit_in(tmp_path)
    if unit is None:
        pytest.skip("pythonfmu is not installed (requirements/fmi.txt)")
    assert_same(drive(trip, str(unit)), driven)


def test_another_law_in_c_drives_another_trip(
    trip: iptm.Trip, driven: Driven, tmp_path: Path
) -> None:
    text = (FOLLOWER / "follower.c").read_text("utf-8")
    assert "2.0 * ego->speed_m_s" in text
    other = tmp_path / "other.c"
    other.write_text(text.replace("2.0 * ego->speed_m_s", "2.1 * ego->speed_m_s"), "utf-8")
    found = drive(trip, str(other))
    assert found is not None
    assert np.abs(found.rows["position_m"] - driven.rows["position_m"]).max() > 0.1


def test_bags_are_judged_by_the_name_of_the_task(tmp_path: Path) -> None:
    (tmp_path / "us06").symlink_to(BAG)
    rows = iptm.load(BAG).trajectory.to_arrays()
    trip = iptm.Trip.of("us06", duration_s=float(rows["time_s"][-1])).changed(name="us06")
    found = drive(trip, str(tmp_path))
    assert found is not None
    np.testing.assert_array_equal(found.rows["position_m"], rows["position_m"])
    assert drive(trip.changed(name="nycc"), str(tmp_path)) is None
    with pytest.raises(iptm.IptmError, match="allowed: the whole task us06"):
        drive(trip.changed(duration_s=60.0), str(tmp_path))


@pytest.mark.parametrize(
    "text", ["nothing.py:Law", str(FOLLOWER / "follower.py"), f"{FOLLOWER / 'follower.c'}:Law"]
)
def test_what_is_no_entrant_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark", "--short", "--quiet", "--entrant", text]) == 2
    assert "allowed: NAME.py:CLASS" in capsys.readouterr().err


def test_a_page_has_no_further_entrant(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark", "--page", "--entrant", PYTHON]) == 2
    assert "--page with --seed or --entrant" in capsys.readouterr().err


def test_a_class_that_is_not_there_is_refused(trip: iptm.Trip) -> None:
    with pytest.raises(iptm.IptmError, match="has no 'Law'"):
        drive(trip, f"{FOLLOWER / 'follower.py'}:Law")

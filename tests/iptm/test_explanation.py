"""Why a run saves: the parts add up to the saving, and the drives behind them agree with the plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import iptm
from iptm.explanation import Cause, replayed
from iptm_core.metrics import Judgement

TRIP = {"cycle": "nycc", "duration_s": 60.0, "compile_code": False}


@pytest.fixture(scope="module")
def runs() -> tuple[iptm.Run, iptm.Run]:
    own = iptm.simulate(**TRIP, horizon="15x1")
    return own, iptm.simulate(**TRIP, horizon="15x1", strategy="reference")


def test_the_parts_add_up_to_the_saving_with_equal_ends(runs: tuple[iptm.Run, iptm.Run]) -> None:
    run, other = runs
    found = run.explain(other)
    assert found.table.index.tolist() == [str(cause) for cause in Cause]
    saving = run.saving(other)
    assert found.table["aging"].sum() == pytest.approx(saving.aging.equal_ends_percent)
    assert found.table["energy"].sum() == pytest.approx(saving.energy.equal_ends_percent)
    remainder = found.table.loc[str(Cause.REMAINDER)]
    assert np.abs(remainder).max() < 0.1
    ends = saving.aging.equal_ends_percent - saving.aging.as_driven_percent
    assert found.table.at[str(Cause.END_STATE), "aging"] == pytest.approx(ends)
    percent = saving.aging.equal_ends_percent
    assert found.sentence.startswith(f"Too short to judge, {percent:+.1f} points")
    judged = replace(saving, aging=replace(saving.aging, judgement=Judgement.JUDGED))
    assert replace(found, saving=judged).sentence.startswith(f"{abs(percent):.1f} % ")


def test_a_drive_with_the_motion_and_the_cooling_of_a_run_is_the_run(
    runs: tuple[iptm.Run, iptm.Run],
) -> None:
    run, _ = runs
    again = replayed(run, run.trajectory, run.trajectory.compressor_power_w)
    for name in ("speed_m_s", "battery_power_w", "cell_n_temperature_k", "cell_1_capacity_loss"):
        expected = getattr(run.trajectory, name)
        np.testing.assert_allclose(getattr(again, name), expected, rtol=1e-6, atol=1e-3)


def test_the_thermal_parts_are_one_drive_apart(runs: tuple[iptm.Run, iptm.Run]) -> None:
    """The motion of the run with the cooling of the other one, against the run."""
    run, other = runs
    found = run.explain(other).table["aging"]
    warmer = replayed(run, run.trajectory, other.trajectory.compressor_power_w)
    losses = [
        float(np.sum([drive.cell_1_capacity_loss[-1], drive.cell_n_capacity_loss[-1]]))
        for drive in (warmer, run.trajectory)
    ]
    points = 100.0 * (losses[0] - losses[1]) / other.metrics.degradation
    thermal = found[str(Cause.TEMPERATURE)] + found[str(Cause.COOLING)]
    assert thermal == pytest.approx(points, abs=0.05)


def test_what_cannot_be_explained_is_refused(runs: tuple[iptm.Run, iptm.Run]) -> None:
    run, other = runs
    for own, against, message in (
        (run, None, "other is None"),
        (replace(run, trip=None), other, "the trip is not known"),
        (run, iptm.simulate(**{**TRIP, "duration_s": 30.0}), "61 and 31 rows"),
        (run, iptm.simulate(**TRIP, overrides={"body.mass_kg": 1600.0}), "the vehicles differ"),
    ):
        with pytest.raises(iptm.IptmError, match=message):
            own.explain(against)

"""The regression is trained on drives, and tried on others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from iptm_drives.commands import train as train_command
from iptm_drives.predictor_training import (
    LEADS_S,
    evaluate,
    samples_of,
    train,
)
from iptm_v2x_bridge.prediction.regression import PAST_S, RegressionModel


def test_samples_by_hand() -> None:
    speed = np.arange(PAST_S + LEADS_S[-1] + 1.0)
    past_m_s, changes_m_s, driven_m = samples_of({"ramp": speed})
    assert past_m_s.tolist() == [list(range(PAST_S, -1, -1))]
    assert changes_m_s.tolist() == [list(LEADS_S)]
    assert driven_m[0, LEADS_S.index(10)] == 10.0 * PAST_S + 50.0


def test_what_is_regular_is_learnt() -> None:
    """Drivers whose speed swings by 5 m/s around 10 m/s in 40 s."""
    seconds = np.arange(900.0)
    drives = {
        str(k): 10.0 + 5.0 * np.sin(2.0 * np.pi * (seconds + 7.0 * k) / 40.0) for k in range(3)
    }
    last = {"2": drives.pop("2")}
    model = train(drives, "made")
    rows = evaluate(model, last)
    assert model.drives == ("0", "1")
    assert rows[3]["lead_s"] == 10.0
    # But for the chords between the lead times.
    assert max(row["rms_m"] for row in rows[:4]) < 0.5
    assert rows[3]["decay_rms_m"] > 10.0
    assert min(row["kept_percent"] for row in rows) > 95.0


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "own.json"
    cycles = ["udds", "hwfet", "us06"]
    assert train_command([*cycles, "--output", str(path), "--source", "EPA, public domain"]) == 0
    out = capsys.readouterr().out
    assert "trained on 2 drives" in out
    assert "tried on 1 others" in out
    model = RegressionModel.load(str(path))
    assert (model.trained_on, model.drives) == ("EPA, public domain", ("udds", "hwfet"))


@pytest.mark.parametrize("source", ["none.csv", "."])
def test_mistakes_are_reported_in_one_line(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert train_command([source]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("iptm train: ")
    assert captured.err.count("\n") == 1

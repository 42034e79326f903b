"""The shipped regression on the trips of the excerpts, which it was not trained on."""

from __future__ import annotations

import json

from studies.validation.excerpts import Driver, drives

from iptm_drives.predictor_training import evaluate
from iptm_v2x_bridge.prediction.regression import RegressionModel


def test_the_shipped_model_is_that_of_trips_that_are_not_in_the_excerpts() -> None:
    """The excerpts of the project are held out, so that they can try it."""
    model = RegressionModel.load()
    others = {
        one.name: one.speed_m_s
        for one in drives()
        if one.driver is Driver.ROAD and one.name not in model.drives
    }
    assert len(others) >= 15
    rows = evaluate(model, others)
    for row in rows:
        assert row["rms_m"] < 0.95 * row["decay_rms_m"]
        assert 98.3 < row["kept_percent"] < 99.7
    assert json.loads(model.as_json())["drives"] == list(model.drives)

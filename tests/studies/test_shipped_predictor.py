"""The shipped regression on the trips of the excerpts, which it was not trained on."""

from __future__ import annotations

import json

from studies.validation.measurements import Driver
from studies.validation.readers.folder import excerpts, files_of, read_files

from iptm.predictor_training import evaluate
from iptm_v2x_bridge.prediction.regression import RegressionModel


def test_the_shipped_model_is_that_of_trips_that_are_not_in_the_excerpts() -> None:
    """The excerpts of the project are held out, so that they can try it."""
    found = read_files(files_of(excerpts()), print).drives
    drives = {
        one.name: one.speed_m_s for one in found if one.driver is Driver.ROAD and one.step_s == 1.0
    }
    model = RegressionModel.load()
    others = {name: drives[name] for name in drives if name not in model.drives}
    assert len(others) >= 15
    rows = evaluate(model, others)
    for row in rows:
        assert row["rms_m"] < 0.95 * row["decay_rms_m"]
        assert 98.3 < row["kept_percent"] < 99.7
    assert json.loads(model.as_json())["drives"] == list(model.drives)

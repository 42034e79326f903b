"""A run compared with another strategy on the same trip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import iptm
from iptm.driving import drive_in_memory
from iptm.report import relative_changes
from iptm.run import Run
from iptm.runner.evaluation import save_comparison
from iptm.trip import Trip
from iptm_core.errors import ParameterError
from iptm_core.metrics.figures import FIGURES, figure_values
from iptm_core.trajectory import TRAJECTORY_COLUMNS

TRIP = Trip.of("nycc", duration_s=60.0)


@pytest.fixture(scope="module")
def comparison() -> Run:
    return drive_in_memory(TRIP.against("reference"))


def test_it_is_the_run_that_a_study_makes(comparison: Run) -> None:
    """The same trip by another path: the arguments of the library."""
    call = {"strategy": "reference", "horizon": "15x1", "duration_s": 60.0}
    from_study = iptm.simulate("nycc", **call).metrics
    for key in ("cooling_energy", "traction_energy", "cell_1_degradation", "smallest_gap"):
        figure = FIGURES[key]
        assert figure.compute(comparison.metrics) == figure.compute(from_study)


def test_changes_by_hand(comparison: Run) -> None:
    base = comparison.metrics
    better = replace(
        base,
        cell_1_degradation=0.75 * base.cell_1_degradation,
        cooling_energy_j=1.1 * base.cooling_energy_j,
    )
    changes = relative_changes(figure_values(better), comparison.figures)
    assert changes["cell_1_degradation"] == pytest.approx(-0.25)
    assert changes["cooling_energy"] == pytest.approx(0.1)


def test_the_other_trajectory_is_kept_as_a_file_for_other_tools(
    comparison: Run, tmp_path: Path
) -> None:
    save_comparison(tmp_path / "reference.parquet", comparison, "demo: us06")
    table = pq.read_table(tmp_path / "reference.parquet")
    assert table.num_rows == 61
    for name in TRAJECTORY_COLUMNS:
        np.testing.assert_array_equal(
            table[name].to_numpy(), getattr(comparison.trajectory, name), err_msg=name
        )
    assert table.schema.metadata[b"iptm_strategy"] == b"reference"
    assert table.schema.metadata[b"iptm_compared_with"] == b"demo: us06"


def test_an_unknown_strategy_is_refused() -> None:
    with pytest.raises(ParameterError, match="'ageing'; did you mean 'aging'\\? allowed: "):
        TRIP.against("ageing")


def test_the_plant_of_the_trip_is_the_one_compared_with() -> None:
    trip = Trip.of("nycc", duration_s=20.0)
    full = drive_in_memory(
        trip.changed(thermal_model="full_channel", period_s=0.5).against("reference")
    )
    usual = drive_in_memory(trip.against("reference"))
    assert (len(full.decisions), len(usual.decisions)) == (40, 20)
    assert full.metrics.degradation != usual.metrics.degradation

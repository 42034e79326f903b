"""The page shows the same saving of a run as every other output."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from tests.iptm_core.made_runs import make_run

from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.metrics.figures import FIGURES
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.metrics.saving import SHORTEST_TRIP_S, Saving, judge_saving
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K
from iptm_view.judged_feed import EVERY_S, JudgedFeed
from iptm_view.page_feed import END, REFERENCE, ROWS, Cursor
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.reference_car import STATE
from iptm_view.reference_drive import COLUMNS
from iptm_view.run_facts import RunFacts

PARAMETERS = load_parameters().values
LAST_S = round(SHORTEST_TRIP_S) + 4
STATE_OF_REFERENCE = {"state": "computing", "strategy": "reference", "columns": list(COLUMNS)}


def car(loss_1_s: float, power_w: float, end_k: float) -> Trajectory:
    times_s = np.arange(LAST_S + 1.0)
    ageing = 1e-3 + loss_1_s * times_s
    temperatures_k = np.linspace(308.0, end_k, times_s.size)
    return make_run(
        times_s.size,
        time_s=times_s,
        position_m=20.0 * times_s,
        speed_m_s=np.full(times_s.size, 20.0),
        leader_position_m=20.0 * times_s + 40.0,
        battery_power_w=power_w * np.linspace(0.8, 1.2, times_s.size),
        cell_1_capacity_loss=ageing,
        cell_n_capacity_loss=1.1 * ageing,
        cell_1_temperature_k=temperatures_k,
        cell_n_temperature_k=temperatures_k,
    )


OWN, OTHER = car(8e-9, 8e3, 307.9), car(1e-8, 9e3, 307.8)


def rows_of(run: Trajectory, columns: tuple[str, ...]) -> list[list[float]]:
    values = {
        **run.to_arrays(),
        "gap_m": run.gap_m,
        "cell_1_temperature_c": run.cell_1_temperature_k - CELSIUS_ZERO_K,
        "cell_n_temperature_c": run.cell_n_temperature_k - CELSIUS_ZERO_K,
        "min_gap_m": run.gap_m - gap_margins_m(run, PARAMETERS),
        "capacity_loss": run.cell_1_capacity_loss + run.cell_n_capacity_loss,
    }
    unknown = np.full(len(run), math.nan)
    return np.transpose([values.get(name, unknown) for name in columns]).tolist()  # type: ignore[no-any-return]


def savings(feed: JudgedFeed) -> list[dict[str, Any]]:
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    return next((json.loads(event.text) for event in events if event.kind == "savings"), [])


def judged(rows: int) -> Saving:
    own, other = (
        compute_metrics(
            Trajectory.from_arrays({n: c[:rows] for n, c in run.to_arrays().items()}), PARAMETERS
        )
        for run in (OWN, OTHER)
    )
    return judge_saving(own, other, PARAMETERS)


@pytest.mark.parametrize("reference_is_first", [True, False])
def test_a_saving_every_ten_seconds_and_at_the_end(reference_is_first: bool) -> None:
    feed = JudgedFeed()
    feed.parameters = PARAMETERS
    feed.put(STATE, STATE_OF_REFERENCE)
    streams = [(ROWS, OWN, tuple(PAGE_COLUMNS)), (REFERENCE, OTHER, COLUMNS)]
    for stream, run, columns in streams[:: -1 if reference_is_first else 1]:
        for row in rows_of(run, columns):
            feed.append(stream, row)
    feed.put(END, {"ended": True})
    found = savings(feed)
    times_s = [entry["time_s"] for entry in found]
    assert times_s[-1] == LAST_S
    assert np.diff(times_s).max() == EVERY_S
    for entry in (found[0], found[-1]):
        expected = judged(round(entry["time_s"]) + 1)
        share = expected.energy
        shown = entry["energy"]["text"], entry["energy"]["as_driven"]
        assert shown == (share.text, share.as_driven)
        for label, text in expected.lines[1:4]:
            assert f"{label}: {text}" in entry["others"]
    assert found[0]["energy"]["text"] == "too short to judge"
    assert found[0]["energy"]["percent"] is None
    assert found[-1]["energy"]["percent"] == pytest.approx(judged(LAST_S + 1).energy.percent)


def test_another_trip_begins_without_savings() -> None:
    feed = JudgedFeed()
    feed.parameters = PARAMETERS
    feed.put(STATE, STATE_OF_REFERENCE)
    for stream, run, columns in ((REFERENCE, OTHER, COLUMNS), (ROWS, OWN, tuple(PAGE_COLUMNS))):
        for row in rows_of(run, columns)[:50]:
            feed.append(stream, row)
    assert savings(feed)
    feed.begin_trip()
    assert not savings(feed)


def test_the_page_is_given_the_definitions_of_the_catalogue() -> None:
    definitions = RunFacts("test").document()["definitions"]
    assert definitions["smallest_margin"] == FIGURES["smallest_margin"].about
    assert "equal" in definitions["aging_saved"]

"""Decisions of a run counted and ranked, against numbers by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.decision_record import (
    DecisionRecord,
    DecisionSeries,
    DecisionStatistics,
    Rung,
    SolveStatus,
)
from iptm_core.errors import StateError


def record(
    status: SolveStatus, rung: Rung, iterations: int, solve_time_s: float, gap_slack_m: float
) -> DecisionRecord:
    return DecisionRecord(
        status=status,
        solve_time_s=solve_time_s,
        iterations=iterations,
        gap_slack_m=gap_slack_m,
        speed_slack_m_s=0.0,
        temperature_slack_k=math.nan,
        objective=1.0,
        rung=rung,
        limiter_active=rung is Rung.SAFE_LAW,
        preview_age_s=math.inf if rung is Rung.STOP else 0.5,
    )


RECORDS = (
    record(SolveStatus.SOLVED, Rung.OPTIMAL, 4, 0.001, 0.0),
    record(SolveStatus.SOLVED, Rung.OPTIMAL, 6, 0.002, 0.5),
    record(SolveStatus.FEASIBLE, Rung.OPTIMAL, 150, 0.003, 0.25),
    record(SolveStatus.NOT_POSED, Rung.STOP, 0, math.nan, math.nan),
    record(SolveStatus.ITERATION_LIMIT, Rung.SAFE_LAW, 150, 0.004, math.nan),
)
SERIES = DecisionSeries.from_records([0.0, 1.0, 2.0, 3.0, 4.0], RECORDS)


def test_series_holds_what_the_records_say() -> None:
    assert SERIES.status.tolist() == [0, 0, 1, -1, 2]
    assert SERIES.rung.tolist() == [0, 0, 0, 3, 2]
    assert SERIES.limiter_active.tolist() == [False, False, False, False, True]
    again = DecisionSeries.from_arrays(SERIES.to_arrays())
    for name, column in SERIES.to_arrays().items():
        np.testing.assert_array_equal(getattr(again, name), column, err_msg=name)
        assert getattr(again, name).dtype == column.dtype


def test_columns_of_unequal_length_are_refused() -> None:
    with pytest.raises(StateError, match="allowed: one value per row"):
        DecisionSeries.from_records([0.0], RECORDS)


def test_statistics_count_every_decision_once() -> None:
    found = DecisionStatistics.of(SERIES)
    assert found.decisions == sum(found.by_status.values()) == sum(found.by_rung.values()) == 5
    assert found.by_status[SolveStatus.SOLVED] == 2
    assert found.by_status[SolveStatus.DEADLINE] == 0
    assert found.by_rung[Rung.OPTIMAL] == 3
    assert (found.fallbacks, found.failed_solves) == (2, 1)
    assert (found.limited, found.without_preview) == (1, 1)


def test_what_is_not_known_does_not_count() -> None:
    found = DecisionStatistics.of(SERIES)
    assert found.solve_time_s["total"] == pytest.approx(0.010)
    assert found.solve_time_s["median"] == pytest.approx(0.0025)
    assert found.solve_time_s["p99"] == pytest.approx(0.00397)
    assert found.iterations["mean"] == pytest.approx(62.0)
    assert found.gap_slack_m["largest"] == 0.5
    assert math.isnan(found.temperature_slack_k["largest"])


def test_no_decision_at_all_is_no_error() -> None:
    found = DecisionStatistics.of(DecisionSeries.from_records([], []))
    assert found.decisions == found.fallbacks == 0
    assert math.isnan(found.solve_time_s["median"])

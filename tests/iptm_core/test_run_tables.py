"""Tables of a run: the trajectory with its checks, and decisions, counted and ranked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_core.made_runs import make_run

from iptm_core.decision_record import (
    DecisionRecord,
    DecisionSeries,
    DecisionStatistics,
    Rung,
    SolveStatus,
)
from iptm_core.errors import StateError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory


def _columns(rows: int = 4) -> dict[str, np.ndarray]:
    return {
        name: 10.0 * index + np.arange(float(rows)) for index, name in enumerate(TRAJECTORY_COLUMNS)
    }


def test_round_trip_through_arrays() -> None:
    columns = _columns()
    run = Trajectory.from_arrays(columns)
    assert list(run.to_arrays()) == list(TRAJECTORY_COLUMNS)
    for name, values in run.to_arrays().items():
        np.testing.assert_array_equal(values, columns[name])
        np.testing.assert_array_equal(values, getattr(run, name))
    again = Trajectory.from_arrays(run.to_arrays())
    np.testing.assert_array_equal(again.battery_power_w, run.battery_power_w)


def test_trajectory_holds_its_own_read_only_copy() -> None:
    columns = _columns()
    run = Trajectory.from_arrays(columns)
    columns["speed_m_s"][0] = 99.0
    assert run.speed_m_s[0] == 20.0
    with pytest.raises(ValueError, match="read-only"):
        run.speed_m_s[0] = 1.0


def test_names_must_be_complete_and_known() -> None:
    columns = _columns()
    del columns["chiller_heat_w"]
    columns["heat"] = np.zeros(4)
    with pytest.raises(StateError, match=r"missing \['chiller_heat_w'\], unknown \['heat'\]"):
        Trajectory.from_arrays(columns)


@pytest.mark.parametrize("name", TRAJECTORY_COLUMNS)
def test_a_column_may_be_unknown_throughout_but_not_the_motion(name: str) -> None:
    columns = _columns()
    columns[name][:] = np.nan
    if name in {"time_s", "position_m", "speed_m_s"}:
        with pytest.raises(StateError, match=f"{name} is nan in row 0"):
            Trajectory.from_arrays(columns)
    else:
        assert Trajectory.from_arrays(columns).unknown == {name: 4}


def test_empty_and_two_dimensional_runs_are_refused() -> None:
    with pytest.raises(StateError, match="0 rows; allowed: at least one"):
        Trajectory.from_arrays(_columns(0))
    with pytest.raises(StateError, match=r"time_s has shape \(1, 4\)"):
        Trajectory.from_arrays({name: values[None, :] for name, values in _columns().items()})


@pytest.mark.parametrize("times", [[0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0]])
def test_times_must_increase(times: list[float]) -> None:
    columns = _columns()
    columns["time_s"] = np.array(times)
    with pytest.raises(StateError, match=r"time_s is 1\.0 in row 2 after"):
        Trajectory.from_arrays(columns)


@pytest.mark.parametrize("name", TRAJECTORY_COLUMNS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_must_be_finite_but_those_of_the_leader_may_be_unknown(
    name: str, value: float
) -> None:
    columns = _columns()
    columns[name][2] = value
    if np.isnan(value) and name in {"leader_position_m", "leader_speed_m_s", "smallest_gap_m"}:
        assert Trajectory.from_arrays(columns).unknown == {name: 1}
        return
    with pytest.raises(StateError, match=f"{name} is {value} in row 2"):
        Trajectory.from_arrays(columns)


def test_lengths_must_agree() -> None:
    columns = {**_columns(), "chiller_heat_w": np.zeros(3)}
    with pytest.raises(StateError, match=r"chiller_heat_w has shape \(3,\); .* \(4,\)"):
        Trajectory.from_arrays(columns)


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


def test_series_holds_the_values_of_the_records() -> None:
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


@pytest.mark.parametrize(
    ("sources", "expected"),
    [
        ([0, 0, 0, 0, 0, 0, 0], (2, 0, 0, "2 ticks on a fallback")),
        # The decisions of 1 s and 3 s, one of them of a fallback, came too late.
        (
            [0, 0, 1, 0, 2, 0, 0],
            (3, 1, 1, "3 ticks on a fallback, 1 of them with an earlier command, "),
        ),
        # Not published: the last instant needs no decision.
        (
            [math.nan] * 7,
            (3, 0, 1, "3 ticks on a fallback, 1 of them stopped for want of commands"),
        ),
    ],
)
def test_fallbacks_are_what_the_vehicle_did(
    sources: list[float], expected: tuple[int, int, int, str]
) -> None:
    run = make_run(7, command_source=sources)
    found = DecisionStatistics.of(SERIES, run)
    assert (found.fallbacks, found.held, found.undecided) == expected[:3]
    assert found.fallbacks_text.startswith(expected[3])
    nothing = DecisionStatistics.of(DecisionSeries.from_records([], []), run)
    assert nothing.undecided == found.undecided * (not math.isnan(sources[0]))


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

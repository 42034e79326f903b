"""The trajectory type: its checks and its round trip through named columns."""

from __future__ import annotations

import numpy as np
import pytest

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

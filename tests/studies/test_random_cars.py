"""Draws of random cars, and what is judged of them on made-up trips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from studies.random_cars.draws import TWIN, random_cases
from studies.random_cars.judging import judge
from studies.session import inputs_of

import iptm
from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import ScenarioError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

CALL = {
    "cycle": "nycc",
    "strategy": "aging_cost_to_go",
    "vehicle": "paper_calibrated",
    "overrides": {},
    "duration_s": 20.0,
    "compile_code": False,
}


def trip(**columns: object) -> Trajectory:
    """A trip of a row per second with the given columns, at 30 degC and 100 m behind a standing leader."""
    rows = max(np.size(column) for column in columns.values())
    calm = dict.fromkeys(TRAJECTORY_COLUMNS, np.zeros(rows))
    calm["time_s"] = np.arange(float(rows))
    calm["leader_position_m"] = np.full(rows, 100.0)
    calm["smallest_gap_m"] = np.full(rows, 1e3)
    for name in TRAJECTORY_COLUMNS:
        if name.endswith("temperature_k"):
            calm[name] = np.full(rows, 303.15)
    return Trajectory.from_arrays({**calm, **columns})  # type: ignore[dict-item]


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    """A short trip."""
    return iptm.simulate(**CALL)


@pytest.fixture
def judged(run: iptm.Run) -> Callable[..., dict[str, float]]:
    """Give the function that judges a trip."""

    def amounts(trajectory: Trajectory, twin: Trajectory | None = None) -> dict[str, float]:
        none = DecisionSeries.from_records([], [])
        pair = [
            None if one is None else replace(run, trajectory=one, decisions=none)
            for one in (trajectory, twin)
        ]
        assert pair[0] is not None
        found = dict(judge("0001", pair[0], CALL, pair[1]).figures)
        del found["ticks"]
        return found

    return amounts


def test_a_longer_study_begins_like_a_shorter_one() -> None:
    few = random_cases(3, 1)
    assert few == random_cases(6, 1)[: len(few)]


def test_runs_are_legal_and_differ() -> None:
    cases = [case for case in random_cases(12, 1) if TWIN not in case.name]
    assert len({str(inputs_of(case.call)) for case in cases}) == 12


@pytest.mark.parametrize(("runs", "seed", "share"), [(0, 1, 0.3), (1, -1, 0.3), (1, 1, 1.5)])
def test_numbers_out_of_range_are_refused(runs: int, seed: int, share: float) -> None:
    with pytest.raises(ScenarioError, match="allowed"):
        random_cases(runs, seed, fault_share=share)


def test_a_share_of_the_runs_has_faults_and_the_cars_stay_as_they_are() -> None:
    none, all_of_them = (random_cases(20, 1, fault_share=share) for share in (0.0, 1.0))
    assert not any("faults" in case.call for case in none)
    assert all("faults" in case.call for case in all_of_them)
    assert [case.call["overrides"] for case in none] == [c.call["overrides"] for c in all_of_them]
    kinds = {fault.kind for case in all_of_them for fault in case.call["faults"]}
    assert len(kinds) > 12


def test_a_calm_trip_has_no_fault(judged: Callable[..., dict[str, float]]) -> None:
    assert set(judged(trip(time_s=np.arange(9.0))).values()) == {0.0}


def test_a_leader_that_backs_into_a_standing_car_is_not_avoidable(
    judged: Callable[..., dict[str, float]],
) -> None:
    found = judged(trip(leader_position_m=[15.0, 15.0, 0.0, -1.0, 15.0]))
    assert (found["collision"], found["collision_leader"]) == (0.0, 2.0)


def test_compressor_energy_counts_where_both_cells_are_cold(
    judged: Callable[..., dict[str, float]],
) -> None:
    run = trip(
        time_s=[0.0, 1.0, 2.0, 4.0],
        cell_1_temperature_k=[290.0, 290.0, 290.0, 290.0],
        cell_n_temperature_k=[290.0, 299.0, 290.0, 290.0],
        compressor_power_w=[9000.0, 100.0, 200.0, 4000.0],
    )
    assert judged(run)["cold_compressor"] == pytest.approx(0.1 + 2 * 4.0)


def test_traction_energy_stands_beside_that_of_the_twin(
    judged: Callable[..., dict[str, float]],
) -> None:
    cold, warm = (trip(traction_power_w=np.full(5, power)) for power in (9e4, 6e4))
    assert judged(cold, warm)["cold_traction"] == pytest.approx(50.0)
    assert "cold_traction" not in judged(cold)

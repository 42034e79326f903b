"""Random cars: what is drawn, what could have been avoided, what is judged, and the command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from iptm.bounds import (
    avoidable_collisions,
    avoidably_below_s_min,
    below_s_min,
    fully_cooled_k,
)
from iptm.faults.kinds import FaultKind
from iptm.studies.campaign import Campaign, admit
from iptm.studies.random_cars import draws
from iptm.studies.random_cars.cli import PAGE, main
from iptm.studies.random_cars.draws import (
    ALWAYS,
    TWIN,
    draw_faults,
    has_twin,
    random_study,
)
from iptm.studies.random_cars.judging import fallback_text, judge
from iptm.studies.run import Run, perform_run
from iptm.studies.run_spec import RunSpec
from iptm.studies.store import ResultStore
from iptm.studies.study import Case, planned_run
from iptm_controller.settings import ControllerSettings
from iptm_core.decision_record import Rung
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.program import EXIT_USER_ERROR
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

PARAMETERS = load_parameters(
    overrides={
        "gap.standstill_gap_m": 5.0,
        "gap.time_headway_s": 1.0,
        "limits.min_acceleration_m_s2": -2.0,
        "limits.max_acceleration_m_s2": 2.0,
        "limits.max_jerk_m_s3": 2.0,
    }
).values
Make = Callable[..., Run]


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


# --- what is drawn


def test_a_longer_campaign_begins_like_a_shorter_one() -> None:
    short, long = random_study(3, 7), random_study(6, 7)
    assert long.cases[: len(short.cases)] == short.cases
    assert random_study(3, 8).cases != short.cases


def test_runs_are_legal_and_differ() -> None:
    study = random_study(40, 3)
    runs = [case.spec for case in study.cases if not case.name.endswith(TWIN)]
    assert len(runs) == 40
    for spec in runs:
        inputs = planned_run(spec)  # refuses what is not legal
        assert 300.0 <= inputs.route.duration_s <= 600.0
        for key, draw in ALWAYS.items():
            low, high = draw
            assert low <= dict(spec.overrides)[key] <= high
    default = ControllerSettings()
    strategies = Counter(spec.strategy.name for spec in runs)
    assert strategies.most_common(1)[0][0] == default.strategy
    assert len(strategies) > 3
    assert Counter(spec.horizon for spec in runs).most_common(1)[0][0] == default.horizon
    for name in ("cycle", "slope", "parameter_set"):
        assert len({getattr(spec, name) for spec in runs}) >= 3


def test_cold_runs_have_a_warm_twin() -> None:
    cases = {case.name: case.spec for case in random_study(16, 3).cases}
    runs = [name for name in cases if not name.endswith(TWIN)]
    for name in runs:
        twin = cases.get(f"{name}_{TWIN}")
        assert (twin is not None) == has_twin(planned_run(cases[name]))
        if twin is not None:
            assert dict(twin.overrides)["environment.ambient_temperature_k"] == 308.15
            changed = {
                key
                for key, value in twin.overrides
                if dict(cases[name].overrides).get(key) != value
            }
            assert {key.split(".")[0] for key in changed} == {"environment", "limits"}
    assert 0 < len(cases) - len(runs) < len(runs)


@pytest.mark.parametrize(("runs", "seed", "share"), [(0, 1, 0.0), (1, -1, 0.0), (1, 1, 1.5)])
def test_numbers_out_of_range_are_refused(runs: int, seed: int, share: float) -> None:
    with pytest.raises(ScenarioError, match="allowed"):
        random_study(runs, seed, fault_share=share)


def test_a_share_of_the_runs_has_faults_and_the_cars_stay_as_they_are() -> None:
    none, some, all_of_them = (
        random_study(20, 5, with_twins=False, fault_share=share).cases for share in (0.0, 0.3, 1.0)
    )
    assert not any(case.spec.faults for case in none)
    assert 1 < sum(bool(case.spec.faults) for case in some) < 12
    assert all(case.spec.faults for case in all_of_them)
    assert [case.spec.overrides for case in none] == [case.spec.overrides for case in all_of_them]
    kinds = {fault.kind for case in all_of_them for fault in case.spec.faults}
    assert len(kinds) > 12


# --- what could have been avoided


def approach(wall_m: float, appears_s: int = 0) -> Trajectory:
    """The ego vehicle keeps 20 m/s; a leader that went as fast is taken for a wall from one second on."""
    seconds = np.arange(20.0)
    position = 20.0 * seconds
    before = seconds < appears_s
    return trip(
        position_m=position,
        speed_m_s=np.full(20, 20.0),
        leader_position_m=np.where(before, position + 60.0, wall_m),
        leader_speed_m_s=np.where(before, 20.0, 0.0),
    )


def test_a_wall_that_was_seen_in_time_is_avoidable() -> None:
    """From 20 m/s and 380 m away, the 100 m to a stop leave more than the 5 m that are asked for."""
    run = approach(380.0)
    below = below_s_min(run, PARAMETERS)
    assert below.any()
    assert not below[0]
    assert np.array_equal(avoidably_below_s_min(run, PARAMETERS, 60.0), below)


def test_a_wall_out_of_nowhere_is_not_avoidable() -> None:
    """Braking for 5 s leaves 10 m/s and 35 m to the wall, where s_min is 5 + 10 + 25 m; 8 s are enough."""
    run = approach(170.0, appears_s=8)
    below = below_s_min(run, PARAMETERS)
    assert np.flatnonzero(below)[0] == 8
    assert not avoidably_below_s_min(run, PARAMETERS, 5.0).any()
    assert avoidably_below_s_min(run, PARAMETERS, 8.0).any()


def test_rows_with_which_a_trip_begins_do_not_count() -> None:
    run = trip(leader_position_m=[3.0, 4.0, 4.9, 6.0, 4.0, 6.0])
    assert below_s_min(run, PARAMETERS).tolist() == [False, False, False, False, True, False]


def test_full_cooling_cools_more(short_run: Run, short_inputs: Case) -> None:
    cooled_k = fully_cooled_k(short_run.trajectory, short_run.parameters, short_inputs.route, 0.05)
    warmest_k = np.maximum(
        short_run.trajectory.cell_1_temperature_k, short_run.trajectory.cell_n_temperature_k
    )
    assert cooled_k.shape == warmest_k.shape
    assert cooled_k[0] == warmest_k[0]
    assert cooled_k[-1] < warmest_k[-1] + 1e-6


# --- what is judged


@pytest.fixture
def judged(make_run: Make, short_inputs: Case) -> Callable[..., dict[str, float]]:
    """Give the function that judges a trip."""

    def amounts(trajectory: Trajectory, twin: Trajectory | None = None) -> dict[str, float]:
        run = make_run(short_inputs)
        pair = [
            None if one is None else replace(run, trajectory=one, decisions=None)
            for one in (trajectory, twin)
        ]
        assert pair[0] is not None
        found = dict(judge("0001", pair[0], short_inputs, pair[1]).figures)
        del found["ticks"]
        return found

    return amounts


def test_a_calm_trip_has_no_fault(judged: Callable[..., dict[str, float]]) -> None:
    assert set(judged(trip(time_s=np.arange(9.0))).values()) == {0.0}


def test_a_leader_that_backs_into_a_standing_car_is_not_avoidable(
    judged: Callable[..., dict[str, float]],
) -> None:
    found = judged(trip(leader_position_m=[15.0, 15.0, 0.0, -1.0, 15.0]))
    assert (found["collision"], found["collision_leader"]) == (0.0, 2.0)


@pytest.mark.parametrize(
    ("appears_s", "informed", "avoidable"),
    [(0, True, True), (9, True, True), (9, False, False), (8, False, True)],
)
def test_only_what_could_be_seen_is_avoidable(
    appears_s: int, *, informed: bool, avoidable: bool
) -> None:
    """0.6 s at 20 m/s, 0.8 s until 8 m/s^2, 16.8^2 / 16 m: 44.8 m. The wall: 60 m at 8 s, 40 m at 9 s."""
    run = approach(220.0, appears_s)
    touching = run.gap_m <= 0.0
    assert touching.any()
    found = avoidable_collisions(run, PARAMETERS, 60.0, informed=informed)
    assert np.array_equal(found, touching & avoidable)


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


def test_fallbacks_have_their_cause(make_run: Make, short_inputs: Case) -> None:
    run = make_run(short_inputs)
    assert run.decisions is not None
    found = judge("0001", run, short_inputs)
    others = (run.decisions.rung != Rung.OPTIMAL) & (run.decisions.rung != Rung.EMERGENCY_BRAKING)
    pairs = zip(run.decisions.rung[others], run.decisions.status[others], strict=True)
    assert found.counts == Counter(fallback_text(*pair) for pair in pairs)
    assert found.figures["emergency"] == (run.decisions.rung == Rung.EMERGENCY_BRAKING).sum()
    assert found.figures["fallback"] == others.sum() > 0
    assert found.figures["ticks"] == 5
    assert "fallback" in found.problems


def test_cells_too_hot_are_charged_only_with_what_cooling_would_have_helped(
    make_run: Make,
) -> None:
    """The cells begin at 45 degC and nothing cools them; full cooling gets them below 40.5 degC in time."""
    spec = RunSpec(
        cycle="smooth",
        duration_s=900.0,
        overrides=(("environment.initial_cell_temperature_k", 318.15),),
    )
    inputs = planned_run(spec)
    hot = np.full(901, 318.15)
    run = replace(
        make_run(inputs),
        trajectory=trip(cell_1_temperature_k=hot, cell_n_temperature_k=hot),
        decisions=None,
    )
    amounts = judge("0001", run, inputs).figures
    assert amounts["too_hot"] > 60.0
    assert amounts["too_hot_anyway"] > 60.0
    assert amounts["too_hot"] + amounts["too_hot_anyway"] == pytest.approx(900.0, abs=2.0)


# --- the command


@pytest.fixture
def small_problems(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grids that compile in no time, and no cluster to start."""

    def execute_here(campaign: Campaign, store: ResultStore, *_: object) -> int:
        missing = admit(campaign, store)
        for inputs in missing:
            run = perform_run(inputs)
            store.save(run)
            campaign.finish(run)
        return len(missing)

    small = {**draws.SETTINGS, "horizon": {"values": ["2x1"]}}
    monkeypatch.setattr(draws, "SETTINGS", small)
    monkeypatch.setattr("iptm.studies.cli.execute", execute_here)


@pytest.mark.usefixtures("small_problems")
def test_the_command_computes_once_and_writes_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--runs", "2", "--seed", "2", "--duration-s", "20", "--workers", "1"]
    arguments += ["--without-twins", "--store", str(tmp_path / "kept")]
    main(arguments)
    assert "2 runs computed, 0 found" in capsys.readouterr().err
    main([*arguments, "--output", str(tmp_path / "docs")])
    output = capsys.readouterr()
    assert "0 runs computed, 2 found" in output.err
    assert "Collision" in output.out
    page = (tmp_path / "docs" / PAGE).read_text(encoding="utf-8")
    assert page == (tmp_path / "kept" / PAGE).read_text(encoding="utf-8")
    assert "2 runs, 40 ticks" in page
    assert str(tmp_path) not in page


def test_the_command_refuses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--runs", "0"]) == EXIT_USER_ERROR
    assert "runs is 0; allowed" in capsys.readouterr().err


def test_faults_last_and_overlap_in_part_of_the_draws() -> None:
    drawn = [draw_faults(np.random.default_rng(seed), 300.0) for seed in range(200)]
    lasting = [any(fault.end_s >= 300.0 + fault.start_s for fault in faults) for faults in drawn]
    pairs = [pair for faults in drawn for pair in pairwise(faults)]
    together = [second.start_s <= first.end_s for first, second in pairs]
    assert 0.2 < np.mean(lasting) < 0.6
    assert 0.4 < np.mean(together) < 0.9
    assert {fault.kind for faults in drawn for fault in faults} == {
        kind for kind in FaultKind if kind.spec.headless
    }

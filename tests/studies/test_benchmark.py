"""The benchmark: its judge against the library's figures, scores that cannot be bought, tasks and draws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.__main__ import main
from studies.acc.run import LONG_S, LONG_SCENES
from studies.acc.scenes import long_scenes
from studies.benchmark import run as benchmark
from studies.benchmark.driving import LAWS, drive, judge, merged
from studies.benchmark.entrants import BY_NAME, ENTRANTS, REFERENCE, LikeOpenpilot
from studies.benchmark.judge import Found, cooled_down, judged, score
from studies.benchmark.kinds import FOLLOWER
from studies.benchmark.library import both_judges, ended_at, ending_kwh
from studies.life.fast_charge import ChargingStopSettings, fast_charge
from studies.pages import STUDIES

import iptm
from iptm_controller.arrival import ArrivalCost
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.metrics.trip_cost import trip_cost

TENTH_OF_A_POINT = 0.1


BAG = STUDIES.parent / "bags" / "example_us06_120s"


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    return iptm.simulate("us06", climate=35.0, strategy="production", preview_mode="none")


@pytest.fixture(scope="module")
def recorded() -> iptm.Run:
    return iptm.load(BAG)


@pytest.mark.parametrize("driven", ["run", "recorded"])
def test_the_judge_finds_what_the_library_finds(
    driven: str, request: pytest.FixtureRequest
) -> None:
    """Two codes, one cost: by each law within 0.1 %, which is less than 0.1 points of a score."""
    run: iptm.Run = request.getfixturevalue(driven)
    use = AgingSettings()
    found = judged(run.trajectory.to_arrays(), run.parameters, use, LAWS)
    metrics = run.metrics
    assert found.gap_m == pytest.approx(metrics.mean_gap_m, rel=2e-3)
    # Between the rows, too.
    assert found.smallest_gap_m <= metrics.smallest_gap_m
    assert found.interventions == metrics.interventions
    kwh = metrics.battery_energy_j - metrics.final_kinetic_energy_j
    assert found.energy_kwh == pytest.approx(kwh / 3.6e6 / metrics.distance_m * 1e5, rel=1e-9)
    assert found.ending_kwh == pytest.approx(ending_kwh(metrics, run.parameters), rel=2e-2)
    # A pack at the lower limit has nothing to be cooled for.
    rows = ended_at(run.trajectory.to_arrays(), run.parameters.limits.min_temperature_k)
    for name, law in (("NCA", "nca"), ("NMC811-Si", "nmc811_si")):
        cost = trip_cost(run.trajectory, metrics, run.parameters, use, law)
        at_rest = judged(rows, run.parameters, use, LAWS)
        own = use.electricity_eur_kwh * at_rest.energy_kwh + at_rest.aging_eur[name]
        assert own == pytest.approx(cost.energy_eur + cost.driving_eur, rel=1e-3)


def both_ways(name: str, trip: iptm.Trip) -> tuple[Found, Found]:
    """Drive with an entrant, and return what the judge and the library find."""
    own = BY_NAME[name]
    run = iptm.drive(merged(trip, own.settings), controller=own.controller(trip))
    return both_judges(run, trip)


def test_a_score_by_the_library_is_the_same_to_a_tenth_of_a_point() -> None:
    """Of every entrant: energy, ageing and the ending by the judge and by the suite."""
    trip = iptm.Trip.of("us06", duration_s=240.0, climate=35.0, preview_length_s=60.0)
    references = [both_ways(each.name, trip) for each in REFERENCE]
    scores = {}
    for entrant in ENTRANTS:
        found = both_ways(entrant.name, trip)
        scores[entrant.name] = [
            score(one, list(reference))
            for one, reference in zip(found, zip(*references, strict=True), strict=True)
        ]
    for name, ((judged_as, reason), (expected, _)) in scores.items():
        assert reason or judged_as == pytest.approx(expected, abs=TENTH_OF_A_POINT), name
    assert sum(not judged_as[1] for judged_as, _ in scores.values()) >= 8


def test_minutes_at_the_charger_cost_what_the_task_states() -> None:
    (task,) = [path for path in benchmark.TASKS if path.stem == "long"]
    trip = iptm.load_trip(task)
    cost = ArrivalCost.parse(trip.controller.arrival_cost_eur)
    assert cost is not None
    kelvin = np.array(cost.celsius) + 273.15
    minutes = fast_charge(kelvin, ChargingStopSettings(), trip.parameters).minutes
    np.testing.assert_allclose(cost.eur, 0.2 * (minutes - minutes[-1]), atol=1e-3)
    short = trip.changed(duration_s=120.0)
    driven = drive(short, "idm")
    found, cold = (judge(driven, each) for each in (short, short.changed(arrival_cost_eur="")))
    km = (driven.rows["position_m"][-1] - driven.rows["position_m"][0]) / 1e3
    assert found.arrival_eur == pytest.approx(
        np.interp(found.end_c, cost.celsius, cost.eur) / km * 100.0
    )
    # A cold pack is not cooled, so that the charge is all that differs.
    assert found.eur - cold.eur == pytest.approx(found.arrival_eur)


def test_a_cold_end_gains_nothing_and_a_warm_one_pays_for_its_heat(run: iptm.Run) -> None:
    use, p = AgingSettings(), run.parameters
    rows, lowest_k = run.trajectory.to_arrays(), p.limits.min_temperature_k

    def at_end(kelvin: float) -> Found:
        return judged(ended_at(rows, lowest_k + kelvin), p, use, LAWS)

    assert at_end(-20.0).eur == pytest.approx(at_end(0.0).eur, rel=1e-3)
    # Heat of ten kelvin at a coefficient of performance between 1.5 and 4, auxiliaries included.
    heat_kwh = 10.0 * p.pack_heat_capacity_j_k / 3.6e6 / run.metrics.distance_m * 1e5
    assert heat_kwh / 4.0 < at_end(10.0).ending_kwh < heat_kwh / 1.5
    more_eur = use.electricity_eur_kwh * at_end(10.0).ending_kwh
    assert at_end(10.0).eur > at_end(0.0).eur + more_eur


def test_heat_is_removed_with_the_least_energy(run: iptm.Run) -> None:
    p = run.parameters
    warm, warmer = (cooled_down(p.limits.min_temperature_k + k, p) for k in (5.0, 10.0))
    assert 0.0 < 2.0 * warm.energy_j < 2.2 * warmer.energy_j
    assert cooled_down(p.limits.min_temperature_k - 5.0, p).energy_j == 0.0


def found(gap_m: float, eur: float, **other: float) -> Found:
    return replace(Found(eur, 15.0, 0.0, gap_m, 1000.0, 0.0, 0.0, 5.0, 0, 0.0, 0.1, 25.0), **other)


def test_scores_compare_at_equal_road_space() -> None:
    reference = [found(60.0, 4.0), found(20.0, 5.0)]
    assert score(found(40.0, 4.5), reference) == (pytest.approx(0.0), "")
    assert score(found(60.0, 3.6), reference) == (pytest.approx(10.0), "")
    assert score(found(10.0, 5.0), reference) == (pytest.approx(0.0), "")
    # A reference that is too close itself cannot be compared with.
    assert score(found(10.0, 5.0), [*reference, found(10.0, 9.0, interventions=9)])[0] == 0.0
    for other, reason in (
        ({"gap_m": 60.1}, "more road"),
        ({"smallest_gap_m": 0.0}, "collision"),
        ({"below_share": 0.21}, "too close"),
        ({"interventions": 3}, "too close"),
    ):
        points, why = score(replace(found(40.0, 1.0), **other), reference)
        assert np.isnan(points)
        assert why == reason


def test_who_is_bad_on_purpose_does_not_win_and_who_has_learned_does() -> None:
    trip = iptm.Trip.of("us06", climate=35.0, preview_length_s=60.0)
    reference = [judge(drive(trip, each.name), trip) for each in REFERENCE]

    def points(name: str) -> float:
        return score(judge(drive(trip, name), trip), reference)[0]

    good = points("rule_preview")
    bad = [points(each.name) for each in ENTRANTS if each.is_bad]
    assert len(bad) == 3
    assert all(not each >= 0.5 * good for each in bad)
    assert (
        points("learned") > 1.0
    )  # than the driver with a thermostat, of whom this is the percentage


def test_entrants_follow_a_steady_leader_at_their_gap() -> None:
    times_s = np.arange(301.0)
    speeds_m_s = np.minimum(times_s * 0.5, 20.0)
    trip = iptm.Trip.of((times_s, speeds_m_s), overrides={"limits.max_jerk_m_s3": 2.0})
    for name, gap_m in (
        ("cacc", 6.0 + 1.6 * 20.0),
        ("linear_mpc", 6.0 + 1.9 * 20.0),
        ("like_openpilot", LikeOpenpilot.stop_m + LikeOpenpilot.time_gap_s * 20.0),
        ("idm", (6.0 + 1.6 * 20.0) / np.sqrt(1.0 - (20.0 / 60.0) ** 4)),
    ):
        rows = drive(trip, name).rows
        before_end = rows["time_s"].size - 60
        gaps_m = rows["leader_position_m"] - rows["position_m"]
        assert gaps_m[before_end] == pytest.approx(gap_m, abs=0.5), name


def test_tasks_are_trips_and_the_leader_is_the_measured_one() -> None:
    assert len(benchmark.TASKS) == 8
    for path in benchmark.TASKS:
        assert iptm.load_trip(path).checked().description
    scene = long_scenes(LONG_SCENES, LONG_S)[0][1]
    folder = Path(benchmark.__file__).parent / "tasks"
    speeds = np.loadtxt(folder / "openacc.csv", delimiter=",", skiprows=1)[:, 1]
    np.testing.assert_allclose(
        speeds[: scene.leader_speed_m_s.size], scene.leader_speed_m_s, atol=1e-3
    )


def test_trips_are_drawn_by_their_seed() -> None:
    first, again, other = (benchmark.drawn(seed) for seed in (1, 1, 2))
    assert [trip.settings for trip in first] == [trip.settings for trip in again]
    assert [trip.settings for trip in first] != [trip.settings for trip in other]
    assert all(trip.checked() for trip in first)


def test_held_out_trips_and_a_further_entrant_make_a_page(tmp_path: Path) -> None:
    given = ["--seed", "3", "--short", "--no-cache", "--quiet", "--workers", "1"]
    given += ["--entrant", f"{FOLLOWER / 'follower.py'}:Follower"]
    assert main(["benchmark", *given, "--output", str(tmp_path)]) == 0
    page = (tmp_path / "README.md").read_text("utf-8")
    assert "--seed 3" in page
    assert page.count("`rule_preview`") > 2
    assert page.count("`follower.py:Follower`") > 2
    assert main(["benchmark", "--seed", "3", "--page"]) == 2

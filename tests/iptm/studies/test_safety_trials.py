"""Safety trials: the independent bound by hand, measured lead vehicles, draws, verdicts, results on disk."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.studies.drives import spec_of
from iptm.studies.measured_cycles import lead_cycles
from iptm.studies.run import VEHICLE, WEAK_BRAKES, Report, Run, perform_run
from iptm.studies.safety.braking import braking_outcomes, braking_trials
from iptm.studies.safety.emergency_stop import braking_leads, emergency_stops
from iptm.studies.safety.findings import BEFORE, Findings, driven, energy_percent, read_before
from iptm.studies.safety.judging import judge_trial
from iptm.studies.safety.page import safety_page
from iptm.studies.safety.trials import disturbed_study
from iptm.studies.store import ResultStore
from iptm.studies.study import Case, Judged, planned_run
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import BrakeParameters
from iptm_core.routes import build_route
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

PARAMETERS = load_parameters().values


def brakes(build_up_m_s3: float = 1e9, delay_s: float = 0.0) -> BrakeParameters:
    """Brakes of 8 m/s^2."""
    return BrakeParameters(8.0, build_up_m_s3, delay_s, 0.0)


def stop(
    gap_m: float,
    speed_m_s: float,
    lead_m_s: float,
    deceleration_m_s2: float,
    own: BrakeParameters,
) -> tuple[float, float]:
    one = np.ones(1)
    gaps, impacts = emergency_stops(
        braking_leads(gap_m * one, lead_m_s * one, deceleration_m_s2 * one),
        0.0 * one,
        speed_m_s * one,
        0.0 * one,
        own,
        0.0,
    )
    return float(gaps[0]), float(impacts[0])


def test_stopping_distances_decide_the_smallest_gap() -> None:
    """20 m/s behind 20 m/s: 400 / 16 = 25 m against 400 / 18 = 22.2 m."""
    gap, impact = stop(10.0, 20.0, 20.0, 9.0, brakes())
    assert gap == pytest.approx(10.0 - 25.0 + 400.0 / 18.0, abs=0.02)
    assert impact == 0.0


def test_reaction_and_build_up_cost_their_way() -> None:
    """0.5 s at 20 m/s are 10 m; a ramp of 8 m/s^2 at 10 m/s^3 costs 0.4 s of braking, less its own share."""
    late, _ = stop(60.0, 20.0, 0.0, 1.0, brakes(delay_s=0.5))
    assert late == pytest.approx(60.0 - 10.0 - 25.0, abs=0.02)
    ramped, _ = stop(60.0, 20.0, 0.0, 1.0, brakes(10.0))
    ramp_m = 20.0 * 0.8 - 10.0 * 0.8**3 / 6.0
    assert ramped == pytest.approx(
        60.0 - ramp_m - (20.0 - 0.5 * 10.0 * 0.8**2) ** 2 / 16.0, abs=0.1
    )


def test_an_impact_has_the_speed_that_is_left() -> None:
    """From 20 m/s at 8 m/s^2 there are sqrt(400 - 160) m/s left after 10 m."""
    gap, impact = stop(10.0, 20.0, 0.0, 1.0, brakes())
    assert gap == pytest.approx(-15.0, abs=0.02)
    assert impact == pytest.approx(240.0**0.5, abs=0.1)


def trip(
    speeds: list[float], gaps: list[float], leads: list[float], **columns: float
) -> Trajectory:
    """A trip at 1 Hz; positions follow from the speeds."""
    rows = len(speeds)
    speed, gap = np.array(speeds), np.array(gaps)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    arrays = {name: np.zeros(rows) for name in TRAJECTORY_COLUMNS}
    arrays |= {
        "time_s": np.arange(rows, dtype=float),
        "position_m": way,
        "speed_m_s": speed,
        "acceleration_m_s2": np.diff(speed, prepend=speed[:1]),
        "leader_position_m": way + gap,
        "leader_speed_m_s": np.array(leads),
        "smallest_gap_m": gap,
    }
    return Trajectory.from_arrays(arrays | {name: np.full(rows, v) for name, v in columns.items()})


COLLISION = trip(
    [10.0] * 8, [15.0, 15.0, 15.0, 12.5, 5.0, -5.0, -15.0, -25.0], [10, 10, 10, 5, 0, 0, 0, 0]
)


def judged(trip: Trajectory, *faults: Fault, report: Report | None = None) -> Judged:
    trial = Judged("0001", "us06", {"disturbed": "leader_surprise, preview", "brake_share": 1.0})
    return judge_trial(trial, trip, PARAMETERS, faults, [report] if report else [])


def test_a_collision_that_brakes_avoid_is_a_problem_and_stands_beside_its_bound() -> None:
    verdict = judged(COLLISION)
    assert verdict.figures["collided_at_s"] == 5.0
    assert verdict.figures["impact_m_s"] == pytest.approx(10.0)
    assert verdict.figures["bound_m"] > 0.0
    assert verdict.problem_text == "avoidable collision"


def test_a_lead_vehicle_that_cuts_in_too_close_cannot_be_avoided() -> None:
    run = trip([20.0] * 6, [60.0, 60.0, 0.5, -14.5, -30.0, -50.0], [20, 20, 5, 5, 5, 5])
    event = Fault(FaultKind.LEADER_CUT_IN, 2.0, 10.0, size=0.5)
    verdict = judged(run, event)
    assert verdict.problem_text == ""
    assert verdict.figures["bound_m"] < 0.0
    weak = Fault(FaultKind.BRAKES_WEAK, size=0.8, duration_s=100.0)
    report = Report(1.0, VEHICLE, f"{WEAK_BRAKES} 80 %")
    assert judged(run, event, weak, report=report).problem_text == ""


def test_weak_brakes_may_touch_gently_and_have_to_be_noticed() -> None:
    weak = Fault(FaultKind.BRAKES_WEAK, size=0.6, duration_s=100.0)
    hard = judged(COLLISION, weak)
    assert hard.problem_text == "impact at 10.0 m/s with weak brakes"
    braking = trip([20.0, 18.0, 16.0, 14.0, 12.0], [50.0] * 5, [20.0] * 5)
    silent = judged(braking, weak)
    assert silent.problem_text == "weak brakes not reported within 1 s of braking"
    verdict = judged(braking, weak, report=Report(1.0, VEHICLE, f"{WEAK_BRAKES} 62 %"))
    assert (verdict.figures["noticed_s"], verdict.problem_text) == (1.0, "")
    # In the interval in which the fault begins, the brakes are sound.
    later = Fault(FaultKind.BRAKES_WEAK, start_s=0.7, size=0.6, duration_s=100.0)
    report = Report(2.0, VEHICLE, f"{WEAK_BRAKES} 62 %")
    verdict = judged(braking, later, report=report)
    assert (verdict.figures["noticed_s"], verdict.problem_text) == (1.0, "")


def test_service_braking_has_to_be_reported_by_the_vehicle() -> None:
    braked = trip([20.0, 15.0, 10.0], [20.0] * 3, [20.0] * 3, service_braking_s=0.5)
    assert judged(braked).problem_text == "service braking not reported in time"
    in_time = Report(2.0, VEHICLE, "service braking: gap 3 m")
    assert judged(braked, report=in_time).figures["report_ticks"] == 2.0


# --- what is driven


def test_measured_lead_vehicles_become_drives_that_end_at_standstill(tmp_path: Path) -> None:
    head = "run,time_s,place,car,speed_m_s,altitude_m,gap_to_car_ahead_m"
    rows = [
        f"run,{0.2 * sample:.1f},{place},CAR,{'' if sample in (100, 101) else 10.0 + place},240.0,"
        for place in (1, 2, 3)
        for sample in range(600)
    ]
    with gzip.open(tmp_path / "platoon.csv.gz", "wt") as file:
        file.write("\n".join((head, *rows)) + "\n")
    left_out: list[str] = []
    cycles = lead_cycles(tmp_path, tmp_path / "leads", left_out.append, 4)
    assert [Path(cycle).stem for cycle in cycles] == ["run_1", "run_2", "run_3"]
    assert left_out == []
    route = build_route(cycles[2], "flat", initial_gap_m=15.0)
    assert route.leader.speeds_m_s.max() == pytest.approx(13.0, rel=0.01)
    assert np.diff(route.leader.speeds_m_s).min() > -1.2
    # From the gap at 20 s on, with a launch in front and a stop behind.
    assert 110.0 < route.duration_s < 130.0


def test_draws_repeat_and_disturb_in_pairs() -> None:
    study = disturbed_study(60, seed=1)
    assert study == disturbed_study(60, seed=1)
    assert study.cases[:20] == disturbed_study(20, seed=1).cases
    disturbed = [str(case.labels["disturbed"]).split(", ") for case in study.cases]
    assert {len(names) for names in disturbed} == {2, 3}
    assert {name for names in disturbed for name in names} >= {
        "preview", "delay", "noise", "bias", "brakes", "leader_surprise", "leader_cut_in",
    }  # fmt: skip


@pytest.fixture(scope="module")
def short_drive() -> tuple[Case, Run]:
    inputs = planned_run(spec_of("nycc", duration_s=60.0))
    return inputs, perform_run(inputs)


def test_the_monitor_alone_avoids_what_brakes_avoid(short_drive: tuple[Case, Run]) -> None:
    inputs, run = short_drive
    found = braking_trials(inputs, run.trajectory, 12, seed=3)
    assert found.smallest_gap_m.min() > 0.0
    assert found.braked.any()
    # A monitor that is not informed beforehand keeps no more than a vehicle that brakes at once.
    assert (found.smallest_gap_m <= found.bound_m + 0.1).all()


def test_braking_trials_are_driven_once(short_drive: tuple[Case, Run], tmp_path: Path) -> None:
    inputs, run = short_drive
    store, names = ResultStore(tmp_path), list[str]()
    drives = {"nycc": (inputs, run.trajectory)}
    first, second = (braking_outcomes(store, drives, 2, 1, 1, names.append) for _ in range(2))
    assert names == ["nycc"]
    assert first.equals(second)


def test_only_collisions_that_stated_brakes_avoid_are_problems(
    short_drive: tuple[Case, Run], tmp_path: Path
) -> None:
    inputs, run = short_drive
    store, drives = ResultStore(tmp_path), {"nycc": (inputs, run.trajectory)}
    braking_outcomes(store, drives, 1, 1, 1, print)
    columns = {"smallest_gap_m": [-1.0, -1.0, 1.0], "bound_m": [1.0, -1.0, 2.0]}
    others = ("time_s", "deceleration_m_s2", "impact_m_s", "braked", "bound_impact_m_s")
    made = {name: np.array(values) for name, values in columns.items()}
    store.save_content(store.keys()[0], {}, made | dict.fromkeys(others, np.ones(3)))
    found = braking_outcomes(store, drives, 1, 1, 0, print)
    assert found.avoidable.tolist() == [True, False, False]
    findings = Findings(found, [], driven([]), driven([]))
    assert findings.broken() == ["braking lead vehicle, nycc: 1 avoidable collisions"]
    page = safety_page("scripts/safety", "abc", findings)
    assert "| nycc | 3 | 3 | 2 | 1 | -1.00 | -1.00 | 1.00 |" in page


def test_energies_are_compared_with_equal_ends(short_drive: tuple[Case, Run]) -> None:
    metrics = short_drive[1].metrics
    warm = replace(metrics, final_temperature_k=metrics.final_temperature_k + 0.5)
    assert energy_percent(metrics, metrics) == 0.0
    assert energy_percent(warm, metrics) > 0.0, "it has yet to be cooled"
    assert np.isnan(energy_percent(metrics, None))


def test_the_page_shows_what_did_not_hold(tmp_path: Path) -> None:
    braking, driving = braking_outcomes(ResultStore(tmp_path), {}, 0, 1, 0, print), driven([])
    findings = Findings(braking, [judged(COLLISION)], driving, driving, read_before(BEFORE))
    page = safety_page("scripts/safety", "abc", findings)
    assert "- trial 0001: avoidable collision" in page
    assert "| `leader_surprise` | 1 | 1 | 1 |" in page

"""Verdicts of the safety trials on made-up trips, and the monitor against the bound."""

from __future__ import annotations

import numpy as np
import pytest
from studies.drives import trip as call_of
from studies.judged import Judged
from studies.safety.braking import braking_trials
from studies.safety.judging import judge_trial

import iptm
from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.run import Report, Reporter
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

PARAMETERS = load_parameters().values


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
    report = Report(1.0, Reporter.VEHICLE, "brakes deliver 80 %", weak_brakes=True)
    assert judged(run, event, weak, report=report).problem_text == ""


def test_weak_brakes_may_touch_gently_and_have_to_be_noticed() -> None:
    weak = Fault(FaultKind.BRAKES_WEAK, size=0.6, duration_s=100.0)
    hard = judged(COLLISION, weak)
    assert hard.problem_text == "impact at 10.0 m/s with weak brakes"
    braking = trip([20.0, 18.0, 16.0, 14.0, 12.0], [50.0] * 5, [20.0] * 5)
    silent = judged(braking, weak)
    assert silent.problem_text == "weak brakes not reported within 1 s of braking"
    verdict = judged(
        braking, weak, report=Report(1.0, Reporter.VEHICLE, "brakes deliver 62 %", weak_brakes=True)
    )
    assert (verdict.figures["noticed_s"], verdict.problem_text) == (1.0, "")
    # In the interval in which the fault begins, the brakes are sound.
    later = Fault(FaultKind.BRAKES_WEAK, start_s=0.7, size=0.6, duration_s=100.0)
    report = Report(2.0, Reporter.VEHICLE, "brakes deliver 62 %", weak_brakes=True)
    verdict = judged(braking, later, report=report)
    assert (verdict.figures["noticed_s"], verdict.problem_text) == (1.0, "")


def test_service_braking_has_to_be_reported_by_the_vehicle() -> None:
    braked = trip([20.0, 15.0, 10.0], [20.0] * 3, [20.0] * 3, service_braking_s=0.5)
    assert judged(braked).problem_text == "service braking not reported in time"
    in_time = Report(2.0, Reporter.VEHICLE, "service braking: gap 3 m")
    assert judged(braked, report=in_time).figures["report_ticks"] == 2.0


def test_the_monitor_alone_avoids_what_brakes_avoid() -> None:
    call = call_of("nycc", duration_s=60.0)
    outcomes = braking_trials(call, iptm.simulate(**call).trajectory, 20, seed=1)
    assert outcomes.braked.any()
    assert not ((outcomes.smallest_gap_m <= 0.0) & (outcomes.bound_m > 0.0)).any()

"""The table of faults: its catalogue, its trips and its verdicts, on made-up trips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from studies.faults import judge
from studies.faults.catalogue import (
    Entry,
    ReportPolicy,
    read_catalogue,
)
from studies.faults.judge import judge_trial
from studies.judged import Judged
from studies.trial import DriveMode, DrivenTrial, StatusReport, Trial, TripTime

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.run import Run
from iptm_core.decision_record import DecisionRecord, DecisionSeries, Rung
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.diagnostics import Level

LOST = Fault(FaultKind.PREVIEW_LOST, 10.0, 10.0)
ROWS = 60
S = 1_000_000_000
Observe = Callable[..., DrivenTrial]
entries: dict[Trial, Entry] = {}
"""Row of the table by the observed trial of its fault."""


def trip_of(**columns: object) -> Trajectory:
    """A minute at 10 m/s, 30 m behind a leader of the same speed."""
    calm = dict.fromkeys(TRAJECTORY_COLUMNS, np.zeros(ROWS))
    calm["time_s"] = np.arange(float(ROWS))
    calm["speed_m_s"] = calm["leader_speed_m_s"] = np.full(ROWS, 10.0)
    calm["position_m"] = 10.0 * calm["time_s"]
    calm["leader_position_m"] = calm["position_m"] + 30.0
    calm["smallest_gap_m"] = np.full(ROWS, 1e3)
    for name in TRAJECTORY_COLUMNS:
        if name.endswith("temperature_k"):
            calm[name] = np.full(ROWS, 303.15)
    return Trajectory.from_arrays({**calm, **columns})  # type: ignore[dict-item]


@pytest.fixture
def observe(decision_record: Callable[[int], DecisionRecord]) -> Observe:
    """Return an observed trial with one fault from 10 s to 20 s."""
    parameters = load_parameters().values

    def made(
        *reports: tuple[float, Level, str],
        fault: Fault = LOST,
        rungs: dict[float, Rung] | None = None,
        ends: bool = False,
        reported: ReportPolicy = ReportPolicy.ALWAYS,
        apart: int = ROWS,
        **columns: object,
    ) -> DrivenTrial:
        entry, run = Entry(fault, reported, ends=ends), trip_of(**columns)
        given = rungs or {}
        records = [replace(decision_record(0), rung=rung) for rung in given.values()]
        decisions = DecisionSeries.from_records(list(given), records)
        # From a row on, the effective leader is not where that of the route is.
        own_m = run.leader_position_m + (np.arange(ROWS) >= apart)
        leader = SimpleNamespace(positions_at=lambda _: own_m)
        road = SimpleNamespace(cycle="us06")
        inputs = SimpleNamespace(
            road=road, parameters=parameters, route=SimpleNamespace(leader=leader)
        )
        trial = Trial(DriveMode.LOCK_STEP, (fault,), inputs)
        entries[trial] = entry
        return DrivenTrial(
            trial,
            Run("made", {}, parameters, run, decisions),
            [StatusReport(time_s, "controller", level, text) for time_s, level, text in reports],
            [(fault.start_s, fault.end_s)],
        )

    return made


def verdict_on(trip: DrivenTrial, observe: Observe) -> Judged:
    return judge_trial(trip, entries[trip.trial], observe())


WARNED = ((0.0, Level.OK, "optimal plans"), (10.0, Level.WARN, "no preview"))
CALM_AGAIN = (20.0, Level.OK, "optimal plans")


def test_a_fault_that_is_reported_and_ends_is_green(observe: Observe) -> None:
    verdict = verdict_on(observe(*WARNED, CALM_AGAIN), observe)
    assert verdict.problem_text == ""
    assert verdict.figures["normal_after"] == 0.0
    assert list(verdict.counts) == ["controller: no preview"]
    assert verdict.labels["level"] == "WARN"
    assert verdict.figures["smallest_gap_m"] == pytest.approx(30.0)


def test_silence_is_red(observe: Observe) -> None:
    silent = (0.0, Level.OK, "optimal plans")
    assert "without a report" in verdict_on(observe(silent), observe).problem_text
    assert (
        verdict_on(observe(silent, reported=ReportPolicy.ONCE), observe).problem_text == "no report"
    )
    assert verdict_on(observe(silent, reported=ReportPolicy.NEVER), observe).problem_text == ""


def test_the_last_message_of_a_run_that_may_end_is_a_report(observe: Observe) -> None:
    silent = observe((0.0, Level.OK, "optimal plans"), ends=True)
    assert verdict_on(silent, observe).problems
    ended = replace(silent, ended="recorder ended with exit code 2")
    verdict = verdict_on(ended, observe)
    assert verdict.problem_text == ""
    assert list(verdict.counts) == ["recorder ended with exit code 2"]


def test_a_fallback_or_a_warning_that_stays_is_not_normal(observe: Observe) -> None:
    late = verdict_on(observe(*WARNED, (28.0, Level.OK, "optimal plans")), observe)
    assert late.problem_text == "normal after 8 ticks"
    rungs = {float(second): Rung.SAFE_LAW for second in range(10, 27)}
    assert (
        verdict_on(observe(*WARNED, CALM_AGAIN, rungs=rungs), observe).figures["normal_after"]
        == 7.0
    )
    assert "not normal again" in verdict_on(observe(*WARNED), observe).problem_text
    flicker = (22.0, Level.WARN, "no preview"), (23.0, Level.OK, "optimal plans")
    verdict = verdict_on(observe(*WARNED, CALM_AGAIN, *flicker), observe)
    assert verdict.figures["normal_after"] == 3.0


def test_a_collision_counts_where_full_braking_avoids_it(observe: Observe) -> None:
    standing = np.full(ROWS, 10.0 * 14 + 30.0)
    leader = np.minimum(10.0 * np.arange(ROWS) + 30.0, standing)
    stop = Fault(FaultKind.LEADER_HARD_STOP, 10.0, 10.0)
    avoidable = observe(
        fault=stop, reported=ReportPolicy.NEVER, apart=11, leader_position_m=leader,
        leader_speed_m_s=np.where(np.arange(ROWS) > 13, 0.0, 10.0),
    )  # fmt: skip
    verdict = verdict_on(avoidable, observe)
    assert verdict.figures["braking_gap_m"] > 0.0 > verdict.figures["smallest_gap_m"]
    assert "collision that brakes avoid" in verdict.problem_text
    # A stop three metres ahead is impossible, but braking less than possible is a failure.
    near = leader - 27.0
    late = observe(fault=stop, reported=ReportPolicy.NEVER, apart=14, leader_position_m=near)
    assert "worse than full braking" in verdict_on(late, observe).problem_text


def test_a_command_beyond_its_bounds_is_red(observe: Observe) -> None:
    acceleration = np.zeros(ROWS)
    acceleration[12:15] = [0.4, 3.5, 0.4]
    verdict = verdict_on(observe(*WARNED, CALM_AGAIN, acceleration_m_s2=acceleration), observe)
    assert "acceleration beyond its limit" in verdict.problem_text


def test_what_was_heard_is_put_where_it_belongs_in_the_last_trip() -> None:
    ticks = [tick * S for tick in range(61)]
    again = TripTime([*ticks, *ticks])  # the plant was started again at 60 s
    assert again.at_s(50 * S, 51) == -11.0
    assert again.at_s(60 * S, 61) == -1.0  # reports of the new plant before its first tick
    assert [again.at_s(0, 62), again.at_s(5 * S, 66)] == [0.0, 5.0]
    doubled = TripTime([*ticks, 0, 61 * S, 0, 62 * S])
    assert doubled.at_s(50 * S, 51) == 50.0
    assert doubled.at_s(0, 62) == 60.0  # reported by the second plant or stamped with its time
    assert doubled.at_s(62 * S, 64) == 62.0


def test_a_restart_of_the_plant_is_judged_by_the_trip_that_it_begins(observe: Observe) -> None:
    fault = Fault(FaultKind.PROCESS_RESTARTED, 30.0, target="plant")
    begun = ((-1.0, Level.WARN, "waiting"), (0.0, Level.WARN, "another trip has begun"))
    trip = observe(
        *begun, (3.0, Level.OK, "optimal plans"), fault=fault, reported=ReportPolicy.ONCE
    )
    verdict = verdict_on(replace(trip, intervals=[(-1.0, -1.0)]), observe)
    assert verdict.problem_text == ""
    assert verdict.figures["normal_after"] == 4.0
    silent = observe((0.0, Level.OK, "optimal plans"), fault=fault, reported=ReportPolicy.ONCE)
    verdict = verdict_on(replace(silent, intervals=[(-1.0, -1.0)]), observe)
    assert verdict.problem_text == "no report"


# --- catalogue and trips


def test_the_page_has_a_row_for_every_entry_of_the_catalogue() -> None:
    """The short form drives a few of them only, so it confirms a page of an older table."""
    page = (Path(judge.__file__).parent / "README.md").read_text(encoding="utf-8")
    _, entries = read_catalogue()
    assert [entry.name for entry in entries if f"| {entry.name} |" not in page] == []


def test_the_shipped_catalogue_has_every_kind() -> None:
    """Those that happen at one instant; cars that cut in at random have a test of their own."""
    cycles, entries = read_catalogue()
    assert len(cycles) >= 2
    at_random = {FaultKind.LEADER_CUT_INS_BY_ROOM, FaultKind.LEADER_CUT_INS_BY_HEADWAY}
    assert {entry.fault.kind for entry in entries} == set(FaultKind) - at_random
    names = [entry.name for entry in entries]
    assert len(names) == len(set(names))

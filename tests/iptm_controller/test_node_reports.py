"""Reports of the node on a decision."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_scene, plain_solver

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.node_reports import Road, plan_trajectory, situation
from iptm_controller.ocp.layout import InputIndex
from iptm_controller.options import ControllerOptions
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.state import LeaderPreview
from iptm_interfaces.codecs import (
    decode_decision_record,
    decode_plan,
    encode_decision_record,
    encode_plan,
)
from iptm_interfaces.diagnostics import Level

EMPTY = LeaderPreview(-math.inf, np.empty(0), np.empty(0), np.empty(0))


@pytest.fixture
def controller() -> Controller:
    return Controller(PARAMETERS, ControllerOptions(), plain_solver("3x1+5x5", compile_code=False))


@pytest.fixture
def good(controller: Controller) -> Decision:
    return controller.decide(make_scene())


def test_record_of_a_good_day(good: Decision) -> None:
    record = good.record
    assert good.result is not None
    assert record.status is SolveStatus.SOLVED
    assert record.iterations == good.result.iterations
    assert record.objective == good.result.objective
    assert record.solve_time_s == good.result.time_s
    assert record.rung is Rung.OPTIMAL
    assert not record.limiter_active
    assert record.preview_age_s == 0.0
    assert record.gap_slack_m == pytest.approx(0.0, abs=1e-5)


def test_record_without_a_solve(controller: Controller) -> None:
    record = controller.decide(replace(make_scene(), leader=None)).record
    assert record.status is SolveStatus.NOT_POSED
    assert record.iterations == 0
    assert record.rung is Rung.STOP
    for value in (record.objective, record.gap_slack_m, record.solve_time_s, record.preview_age_s):
        assert math.isnan(value)


@pytest.mark.parametrize("change", [{}, {"leader": None}, {"state": None}, {"preview": EMPTY}])
def test_every_record_travels(controller: Controller, change: dict[str, object]) -> None:
    measured = replace(make_scene(), **change)  # type: ignore[arg-type]
    record = controller.decide(measured).record
    again = decode_decision_record(encode_decision_record(100_000_000_000, record))
    assert repr(again) == repr(record)  # by text, as NaN does not equal itself


def test_plan_travels_with_its_node_times(good: Decision) -> None:
    assert good.plan is not None
    trajectory = plan_trajectory(good.plan)
    assert trajectory.times_s.tolist() == [100.0, 101, 102, 103, 108, 113, 118, 123, 128]
    assert trajectory.positions_m[0] == pytest.approx(1000.0)
    np.testing.assert_array_equal(trajectory.accelerations_m_s2[:-1], good.plan.inputs[:, 0])
    assert trajectory.accelerations_m_s2[-1] == trajectory.accelerations_m_s2[-2]
    assert trajectory.compressor_powers_w[-1] == trajectory.compressor_powers_w[-2]
    _, again = decode_plan(encode_plan(trajectory, 100_000_000_000))
    for name, values in vars(trajectory).items():
        np.testing.assert_allclose(getattr(again, name), values, atol=1e-9)


def test_severity_follows_the_rung(good: Decision) -> None:
    levels = {rung: situation(replace(good, rung=rung), Road(known=True))[0] for rung in Rung}
    assert levels == {
        Rung.OPTIMAL: Level.OK,
        Rung.SHIFTED_PLAN: Level.WARN,
        Rung.SAFE_LAW: Level.ERROR,
        Rung.STOP: Level.ERROR,
        Rung.EMERGENCY_BRAKING: Level.ERROR,
    }


def test_an_early_stop_a_bad_preview_and_a_bad_road_are_warnings(good: Decision) -> None:
    assert good.result is not None
    assert good.forecast is not None
    early = replace(good, result=replace(good.result, status=SolveStatus.FEASIBLE))
    assert situation(early, Road(known=True))[0] is Level.WARN
    seen = set()
    for quality in range(1, 5):
        poor = replace(good, forecast=replace(good.forecast, quality=type(
            good.forecast.quality)(quality)))  # fmt: skip
        level, reason = situation(poor, Road(known=True))
        assert level is (Level.OK if quality == 1 else Level.WARN)
        seen.add(reason)
    assert len(seen) == 4
    assert situation(good, Road(known=False))[0] is Level.WARN
    assert situation(good, Road(known=True, fault="wrong layout"))[0] is Level.WARN
    assert situation(good, Road(known=True)) == (Level.OK, "optimal plans")


@pytest.mark.parametrize(
    ("column", "limits"),
    [
        (InputIndex.GAP_SHORT, "gap"),
        (InputIndex.GAP_LONG, "gap"),
        (InputIndex.SPEED_EXCESS, "speed"),
        (InputIndex.TEMPERATURE_EXCESS, "temperature"),
    ],
)
def test_a_plan_that_breaks_limits_is_no_optimal_plan(
    good: Decision, column: InputIndex, limits: str
) -> None:
    assert good.plan is not None
    inputs = good.plan.inputs.copy()
    inputs[3, column] = 0.5
    broken = replace(good, plan=replace(good.plan, inputs=inputs))
    assert situation(broken, Road(known=True)) == (Level.WARN, f"plans break limits of {limits}")


def test_the_road_is_called_flat_only_where_it_is_taken_as_flat(good: Decision) -> None:
    _, kept = situation(good, Road(known=True, fault="wrong layout"))
    assert kept == "slope message malformed, the last good one is used"
    _, flat = situation(good, Road(known=False, fault="wrong layout"))
    assert flat == "slope message malformed, road taken as flat"


def test_another_trip_is_told_beside_what_is_worse(controller: Controller) -> None:
    blind = controller.decide(replace(make_scene(), leader=None))
    road = Road(known=True)
    assert situation(blind, road, begun_anew=True) == (
        Level.ERROR,
        "another trip has begun, controlled stop",
    )

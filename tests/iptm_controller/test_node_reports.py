"""Reports of the node on a decision, and warnings of what has gone on for too long."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import NOW_S, PARAMETERS, make_scene, plain_solver
from tests.table_messages import encode_plan

from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.node_reports import (
    COLD,
    OperatorWatch,
    plan_trajectory,
    road_warning,
    situation,
)
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import WarningSettings
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.metrics.constraints import Concern
from iptm_core.state import LeaderPreview
from iptm_ros.codecs import (
    decode_decision_record,
    decode_plan,
    encode_decision_record,
)
from iptm_ros.diagnostics import Level

HOT_K = PARAMETERS.limits.max_temperature_k + 2.0
FULL_W = PARAMETERS.limits.max_compressor_power_w
SETTINGS = WarningSettings(
    motion_warning_s=5.0, temperature_warning_s=8.0, cooling_warning_s=6.0, plan_warning_s=7.0
)
GOOD_ROAD = road_warning("", is_known=True)
EMPTY = LeaderPreview.empty()


def fresh() -> MpcController:
    return MpcController(PARAMETERS, ControllerOptions(), plain_solver("3x1+5x5"))


@pytest.fixture
def controller() -> MpcController:
    return fresh()


@pytest.fixture(scope="module")
def good() -> Decision:
    return fresh().decide(make_scene())


def test_record_of_an_optimal_tick(good: Decision) -> None:
    record = good.record
    assert record.status is SolveStatus.SOLVED
    assert record.iterations == good.result.iterations
    assert record.objective == good.result.objective
    assert record.solve_time_s == good.result.time_s
    assert record.rung is Rung.OPTIMAL
    assert not record.limiter_active
    assert record.preview_age_s == 0.0
    assert record.gap_slack_m == pytest.approx(0.0, abs=1e-5)


def test_record_without_a_solve(controller: MpcController) -> None:
    record = controller.decide(replace(make_scene(), leader=None)).record
    assert record.status is SolveStatus.NOT_POSED
    assert record.iterations == 0
    assert record.rung is Rung.STOP
    for value in (record.objective, record.gap_slack_m, record.solve_time_s, record.preview_age_s):
        assert math.isnan(value)


@pytest.mark.parametrize("change", [{}, {"leader": None}, {"state": None}, {"preview": EMPTY}])
def test_every_record_travels(controller: MpcController, change: dict[str, object]) -> None:
    measured = replace(make_scene(), **change)  # type: ignore[arg-type]
    record = controller.decide(measured).record
    again = decode_decision_record(encode_decision_record(100_000_000_000, record))
    assert repr(again) == repr(record)  # by text, as NaN does not equal itself


def test_plan_travels_with_its_node_times(good: Decision) -> None:
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
    levels = {rung: situation(replace(good, rung=rung), GOOD_ROAD)[0] for rung in Rung}
    assert levels == {
        Rung.OPTIMAL: Level.OK,
        Rung.SHIFTED_PLAN: Level.WARN,
        Rung.SAFE_LAW: Level.ERROR,
        Rung.STOP: Level.ERROR,
        Rung.EMERGENCY_BRAKING: Level.ERROR,
    }


def test_an_early_stop_a_bad_preview_and_a_bad_road_are_warnings(good: Decision) -> None:
    early = replace(good, result=replace(good.result, status=SolveStatus.FEASIBLE))
    assert situation(early, GOOD_ROAD)[0] is Level.WARN
    seen = set()
    for quality in range(1, 5):
        poor = replace(good, forecast=replace(good.forecast, quality=type(
            good.forecast.quality)(quality)))  # fmt: skip
        level, reason = situation(poor, GOOD_ROAD)
        assert level is (Level.OK if quality == 1 else Level.WARN)
        seen.add(reason)
    assert len(seen) == 4
    assert situation(good, road_warning("", is_known=False))[0] is Level.WARN
    assert situation(good, road_warning("wrong layout", is_known=True))[0] is Level.WARN
    assert situation(good, GOOD_ROAD) == (Level.OK, "optimal plans")


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
    inputs = good.plan.inputs.copy()
    inputs[3, column] = 0.5
    broken = replace(good, plan=replace(good.plan, inputs=inputs))
    assert situation(broken, GOOD_ROAD) == (Level.WARN, f"plans break limits of {limits}")


def test_the_road_is_called_flat_only_where_it_is_taken_as_flat(good: Decision) -> None:
    _, kept = situation(good, road_warning("wrong layout", is_known=True))
    assert kept == "slope message malformed, the last good one is used"
    _, flat = situation(good, road_warning("wrong layout", is_known=False))
    assert flat == "slope message malformed, road taken as flat"


def test_another_trip_is_reported_with_what_is_worse(controller: MpcController) -> None:
    blind = controller.decide(replace(make_scene(), leader=None))
    road = GOOD_ROAD
    assert situation(blind, road, begun_anew=True) == (
        Level.ERROR,
        "another trip has begun, controlled stop",
    )


# --- what has gone on for too long


def reports_of(decision: Decision, seconds: int, **scene: float) -> Iterator[tuple[Level, str]]:
    """Yield the report of every tick of a constant scene."""
    watch = OperatorWatch(PARAMETERS, SETTINGS)
    for second in range(seconds):
        watch.update(make_scene(time_s=NOW_S + second, **scene), decision)
        yield situation(decision, GOOD_ROAD, watch=watch)


@pytest.mark.parametrize(
    ("scene", "after_s", "reason"),
    [
        ({"gap_m": 3.0}, 5, "gap below s_min for long"),
        ({"gap_m": 500.0}, 5, "gap above s_max for long"),
        (
            {"speed_m_s": 60.0, "leader_speed_m_s": 60.0, "gap_m": 119.0},
            5,
            "speed out of its limits for long",
        ),
        ({"cell_1_temperature_k": HOT_K}, 8, "cell above its highest temperature for long"),
    ],
)
def test_a_measured_limit_broken_for_long_is_a_warning(
    good: Decision, scene: dict[str, float], after_s: int, reason: str
) -> None:
    reports = list(reports_of(good, 20, **scene))
    assert reports[: after_s + 1] == [(Level.OK, "optimal plans")] * (after_s + 1)
    assert reports[after_s + 1 :] == [(Level.WARN, reason)] * (19 - after_s)


def test_a_compressor_at_its_limit_without_effect_is_a_warning(good: Decision) -> None:
    scene = {"cell_n_temperature_k": HOT_K, "compressor_power_w": FULL_W}
    reports = list(reports_of(good, 20, **scene))
    assert reports[6] == (Level.OK, "optimal plans")
    assert reports[7] == (Level.WARN, "compressor at its limit without effect")
    assert reports[9][1] == (
        "cell above its highest temperature for long, compressor at its limit without effect"
    )


@pytest.mark.parametrize(
    ("state", "value"), [(StateIndex.CELL_N_TEMPERATURE, HOT_K), (StateIndex.POSITION, 1e4)]
)
def test_plans_that_never_get_back_within_limits_are_a_warning(
    good: Decision, state: StateIndex, value: float
) -> None:
    states = good.plan.states.copy()
    states[:-1, state] = value
    recovering = replace(good, plan=replace(good.plan, states=states))
    assert set(reports_of(recovering, 20)) == {(Level.OK, "optimal plans")}
    states = good.plan.states.copy()
    states[-1, state] = value
    hopeless = replace(good, plan=replace(good.plan, states=np.array(states)))
    reports = list(reports_of(hopeless, 20))
    assert reports[7] == (Level.OK, "optimal plans")
    assert reports[8] == (Level.WARN, "plans never get back within limits")


def test_a_leader_without_distance_is_an_error_at_once(good: Decision) -> None:
    assert list(reports_of(good, 1, gap_m=-3.0)) == [
        (Level.ERROR, "the leader is measured at no distance")
    ]
    assert next(reports_of(good, 1, gap_m=0.1))[0] is Level.OK


def test_a_cold_pack_is_noted_without_a_warning(good: Decision) -> None:
    reports = set(reports_of(good, 100, cell_1_temperature_k=280.0, cell_n_temperature_k=280.0))
    assert reports == {(Level.OK, f"optimal plans, {COLD}")}


def test_a_fallback_keeps_its_severity_and_reports_both(good: Decision) -> None:
    *_, (level, reason) = reports_of(replace(good, rung=Rung.SAFE_LAW), 20, gap_m=3.0)
    assert level is Level.ERROR
    assert reason.startswith("no usable solution")
    assert reason.endswith("gap below s_min for long")


def test_a_warning_ends_with_its_cause(good: Decision) -> None:
    watch = OperatorWatch(PARAMETERS, SETTINGS)
    for second in range(10):
        watch.update(make_scene(time_s=NOW_S + second, gap_m=3.0), good)
    assert watch.warnings
    assert watch.values[f"{Concern.SHORT_GAP.value}_s"] == 9.0
    watch.update(replace(make_scene(time_s=NOW_S + 10.0), leader=None), good)
    assert watch.warnings, "a tick without a measurement ends nothing"
    watch.update(make_scene(time_s=NOW_S + 11.0), good)
    assert not watch.warnings

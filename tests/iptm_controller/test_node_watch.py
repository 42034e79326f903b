"""When the operator is warned: after the stated time, with the reason, until it is over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import NOW_S, PARAMETERS, make_scene, plain_solver

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.node_reports import Road, situation
from iptm_controller.node_watch import COLD, OperatorWatch, WarningSettings
from iptm_controller.ocp.layout import StateIndex
from iptm_controller.options import ControllerOptions
from iptm_core.decision_record import Rung
from iptm_core.metrics import Concern
from iptm_interfaces.diagnostics import Level

HOT_K = PARAMETERS.limits.max_temperature_k + 2.0
FULL_W = PARAMETERS.limits.max_compressor_power_w
SETTINGS = WarningSettings(
    motion_warning_s=5.0, temperature_warning_s=8.0, cooling_warning_s=6.0, plan_warning_s=7.0
)


@pytest.fixture(scope="module")
def good() -> Decision:
    controller = Controller(
        PARAMETERS, ControllerOptions(), plain_solver("3x1+5x5", compile_code=False)
    )
    return controller.decide(make_scene())


def reports_of(decision: Decision, seconds: int, **scene: float) -> Iterator[tuple[Level, str]]:
    """Yield the report of every tick of a constant scene."""
    watch = OperatorWatch(PARAMETERS, SETTINGS)
    for second in range(seconds):
        watch.update(make_scene(time_s=NOW_S + second, **scene), decision)
        yield situation(decision, Road(known=True), watch=watch)


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
    assert good.plan is not None
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


def test_a_cold_pack_is_worth_a_word_and_no_warning(good: Decision) -> None:
    reports = set(reports_of(good, 100, cell_1_temperature_k=280.0, cell_n_temperature_k=280.0))
    assert reports == {(Level.OK, f"optimal plans, {COLD}")}


def test_a_fallback_keeps_its_severity_and_tells_both(good: Decision) -> None:
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

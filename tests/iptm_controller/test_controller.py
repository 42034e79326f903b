"""The controller as a whole: from measurements to a limited command, with and without failures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, FailingSolver, make_scene, plain_solver

from iptm_controller.controller import MpcController
from iptm_controller.decision import ControllerMemory, Decision
from iptm_controller.forecast import PreviewQuality
from iptm_controller.ladder import safe_following, thermostat_power_w
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.layout import InputIndex
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.interface import STATUS_TEXT, SolveResult
from iptm_controller.strategy import STRATEGIES
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.saved_state import from_plain, to_plain
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState


@pytest.fixture
def backend() -> FailingSolver:
    return FailingSolver(plain_solver("3x1+5x5"))


@pytest.fixture
def controller(backend: FailingSolver) -> MpcController:
    options = ControllerOptions(shifted_plan_ticks=2, safe_law_ticks=3)
    return MpcController(PARAMETERS, options, backend)


def at(time_s: float, **changes: float) -> Measurements:
    """A steady trip: ego vehicle and leader go on at 15 m/s."""
    return make_scene(time_s=time_s, position_m=15.0 * time_s - 500.0, **changes)


def expect_actuable(decision: Decision, state: VehicleState) -> None:
    limits, command = PARAMETERS.limits, decision.command
    assert math.isfinite(command.acceleration_m_s2)
    assert abs(command.acceleration_m_s2 - state.acceleration_m_s2) <= limits.max_jerk_m_s3 + 1e-9
    assert limits.min_compressor_power_w <= command.compressor_power_w
    change = abs(command.compressor_power_w - state.compressor_power_w)
    assert change <= limits.max_compressor_rate_w_s + 1e-6


def test_ordinary_tick_is_optimal(controller: MpcController) -> None:
    measured = make_scene()
    decision = controller.decide(measured)
    assert decision.rung is Rung.OPTIMAL
    assert decision.reason == ""
    assert decision.result.status is SolveStatus.SOLVED
    assert decision.forecast.quality is PreviewQuality.FULL
    assert decision.plan.start_s == 100.0
    # What is actuated is the first input of the plan: the limiter has nothing to do.
    assert not decision.limits
    planned = decision.plan.inputs[0]
    assert decision.command.acceleration_m_s2 == pytest.approx(planned[InputIndex.ACCELERATION])
    assert decision.command.compressor_power_w == pytest.approx(
        planned[InputIndex.COMPRESSOR_POWER], abs=1e-3
    )
    expect_actuable(decision, measured.state)


def test_the_last_plan_warms_up_the_next_solve(controller: MpcController) -> None:
    first = controller.decide(at(100.0))
    second = controller.decide(at(101.0))
    assert second.result.iterations < first.result.iterations


@pytest.mark.parametrize(
    "failure", [SolveStatus.ITERATION_LIMIT, SolveStatus.DEADLINE, SolveStatus.NUMERICAL_ERROR]
)
def test_failed_solves_walk_down_the_ladder_and_back(
    controller: MpcController, backend: FailingSolver, failure: SolveStatus
) -> None:
    good = controller.decide(at(100.0))
    backend.failure = failure
    rungs = []
    for tick in range(1, 8):
        measured = at(100.0 + tick)
        decision = controller.decide(measured)
        rungs.append(decision.rung)
        assert decision.reason == STATUS_TEXT[failure]
        assert decision.plan is None
        assert decision.result.status is failure
        expect_actuable(decision, measured.state)
        if decision.rung is Rung.SHIFTED_PLAN:
            braking_at_least = min(
                good.plan.command_at(100.0 + tick).acceleration_m_s2,
                safe_following(measured.state, measured.leader, PARAMETERS).acceleration_m_s2,
            )
            assert decision.command.acceleration_m_s2 == pytest.approx(braking_at_least)
    assert rungs == [Rung.SHIFTED_PLAN] * 2 + [Rung.SAFE_LAW] * 3 + [Rung.STOP] * 2
    backend.failure = None
    recovered = controller.decide(at(108.0))
    assert recovered.rung is Rung.OPTIMAL
    assert recovered.reason == ""


def test_a_back_end_that_raises_has_broken_off(backend: FailingSolver) -> None:
    class Raising(FailingSolver):
        def solve(self, *_: object, **__: object) -> SolveResult:
            raise RuntimeError("out of nowhere")

    controller = MpcController(PARAMETERS, ControllerOptions(), Raising(backend))
    decision = controller.decide(at(100.0))
    assert decision.rung is Rung.SAFE_LAW
    assert decision.record.status is SolveStatus.NUMERICAL_ERROR
    assert decision.reason.endswith("RuntimeError: out of nowhere")


def test_no_leader_is_a_fallback_with_the_reason_given(controller: MpcController) -> None:
    controller.decide(at(100.0))
    blind = replace(at(101.0), leader=None, fault="radar covered by snow")
    decision = controller.decide(blind)
    assert decision.rung is Rung.SHIFTED_PLAN
    assert decision.reason == "radar covered by snow"
    assert decision.result is None
    assert decision.forecast is None
    unexplained = controller.decide(replace(at(102.0), leader=None))
    assert unexplained.reason == "no measurement of the leader"


@pytest.mark.parametrize(
    ("change", "rung", "reason"),
    [
        ({"leader": LeaderState(100.0, -5e4, 15.0)}, Rung.STOP, "measured gap is "),
        ({"slope": SlopePreview(np.empty(0), np.empty(0))}, Rung.SAFE_LAW, "slope has 0 positions"),
        (
            {"state": at(100.0, speed_m_s=-3.0).state},
            Rung.STOP,
            "measured speed_m_s is -3.0; allowed",
        ),
    ],
)
def test_what_cannot_be_is_a_fallback_with_a_reason(
    controller: MpcController, change: dict[str, Any], rung: Rung, reason: str
) -> None:
    decision = controller.decide(replace(at(100.0), **change))
    assert decision.rung is rung
    assert decision.reason.startswith(reason)
    assert controller.decide(at(101.0)).rung is Rung.OPTIMAL


def test_before_any_state_it_asks_for_nothing(controller: MpcController) -> None:
    decision = controller.decide(replace(at(0.0), state=None, fault="still booting"))
    assert decision.rung is Rung.STOP
    assert decision.reason == "still booting"
    assert vars(decision.command) == {"acceleration_m_s2": 0.0, "compressor_power_w": 0.0}
    assert decision.limits


@pytest.mark.parametrize("last", [2.0, 0.0, -1.5])
def test_without_a_state_it_brakes_step_by_step(controller: MpcController, last: float) -> None:
    """Rates count from what was commanded since, not from the last state that was seen."""
    seen = at(100.0, acceleration_m_s2=last, compressor_power_w=700.0)
    first = controller.decide(seen).command
    lost = replace(seen, state=None, fault="no state")
    commands = [controller.decide(lost).command for _ in range(12)]
    # The last actuated input is unknown: the first step starts from the measured one.
    before = seen.state
    previous = before.acceleration_m_s2
    for command in commands:
        assert abs(command.acceleration_m_s2 - previous) <= 0.5 + 1e-9
        previous = command.acceleration_m_s2
    assert commands[-1].acceleration_m_s2 == min(last, -1.0)  # what was braked harder stays so
    assert commands[-1].compressor_power_w == pytest.approx(thermostat_power_w(before, PARAMETERS))
    assert controller.decide(at(113.0)).rung is Rung.OPTIMAL
    assert first.acceleration_m_s2 <= last + 0.5 + 1e-9


@pytest.mark.parametrize(
    ("quality", "change"),
    [
        (PreviewQuality.MISSING, lambda _: LeaderPreview.empty()),
        (PreviewQuality.INVALID, lambda p: replace(p, speeds_m_s=-p.speeds_m_s)),
        (PreviewQuality.STALE, lambda p: replace(p, times_s=p.times_s - 50.0)),
    ],
)
def test_without_a_usable_preview_it_still_optimises(
    controller: MpcController,
    quality: PreviewQuality,
    change: Callable[[LeaderPreview], LeaderPreview],
) -> None:
    measured = at(100.0)
    decision = controller.decide(replace(measured, preview=change(measured.preview)))
    assert decision.rung is Rung.OPTIMAL
    assert decision.forecast.quality is quality
    assert decision.reason == decision.forecast.reason != ""


def test_a_new_trip_needs_no_new_controller(controller: MpcController) -> None:
    """Neither the plan nor the leader of the last trip is taken for this one's."""
    for tick in range(5):
        controller.decide(at(500.0 + tick))
    again = controller.decide(make_scene(time_s=0.0, position_m=0.0))
    assert again.rung is Rung.OPTIMAL
    assert again.forecast.motion.times_s.min() == 0.0


def test_after_an_outage_it_starts_cold(controller: MpcController) -> None:
    """A plan that has ended long ago would only repeat its last input."""
    options = replace(controller.options, strategy=STRATEGIES["aging"])
    resumed = MpcController(PARAMETERS, options, controller.backend)
    resumed.decide(at(100.0, leader_acceleration_m_s2=1.0))
    late = at(400.0)
    recovered = resumed.decide(late)
    assert recovered.rung is Rung.OPTIMAL
    fresh = MpcController(PARAMETERS, options, controller.backend).decide(late)
    assert recovered.command == fresh.command


def test_it_goes_on_from_a_saved_memory(controller: MpcController) -> None:
    """With noisy measurements, late commands and previews that were wrong, which all leave traces."""
    random = np.random.default_rng(6)

    def noisy(tick: int) -> Measurements:
        measured = at(100.0 + tick, acceleration_m_s2=0.3 * math.sin(tick - 2.0))
        state, leader = measured.state, measured.leader
        moved_m = float(random.normal(0.0, 0.5))
        return replace(
            measured,
            state=replace(state, speed_m_s=state.speed_m_s + float(random.normal(0.0, 0.3))),
            leader=replace(
                leader,
                # Slower than its preview states, by position and speed.
                position_m=leader.position_m + 90.0 - 3.0 * tick + moved_m,
                speed_m_s=12.0,
            ),
        )

    for tick in range(30):
        before = controller.decide(noisy(tick))
    assert before.noise
    assert "previews were wrong" in before.reason
    other = MpcController(PARAMETERS, controller.options, controller.backend)
    other.memory = from_plain(ControllerMemory, to_plain(controller.memory))
    for tick in range(30, 35):
        measured = noisy(tick)
        assert other.decide(measured).command == controller.decide(measured).command


@pytest.mark.parametrize("law", [None, LAWS["nmc622"]])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_controller_has_a_memory(
    controller: MpcController, law: AgingLaw | None, strategy: str
) -> None:
    options = replace(controller.options, own_law=law, strategy=STRATEGIES[strategy])
    other = MpcController(PARAMETERS, options, controller.backend)
    memory = replace(ControllerMemory(), failures=2, lost_ticks=1, is_cooling=True)
    other.memory = memory
    assert to_plain(other.memory) == to_plain(memory)

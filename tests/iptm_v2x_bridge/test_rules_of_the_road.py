"""The rules of the road as a leader: by hand, and driven by the real controller."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_controller.controller import Controller
from iptm_controller.options import ControllerOptions
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.settings import PreviewSettings
from iptm_core.state import LeaderPreview, LeaderState
from iptm_core.trip_time import NS_PER_S
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_studies.closed_loop import run_closed_loop
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.prediction.road_rules import GivenRules
from iptm_v2x_bridge.prediction.signals import CyclicSignal, SignalPlan
from iptm_v2x_bridge.prediction.speed_limits import SpeedLimits
from iptm_v2x_bridge.rules_of_the_road import STOP_BEFORE_M, RulesOfTheRoad

LIMITS = SpeedLimits(np.array([0.0]), np.array([14.0]))
PARAMETERS = load_parameters().values
GAP = PARAMETERS.gap
CLOSED = CyclicSignal(400.0, 1000.0, 900.0, 50.0)
OPEN = CyclicSignal(400.0, 1000.0, -10.0, 900.0)


class Heard:
    """A bridge that hears of a leader which keeps its speed, foretold for some seconds."""

    def __init__(self, gap_m: float | None, speed_m_s: float = 10.0, known_s: float = 60.0) -> None:
        self.gap_m, self.speed_m_s, self.known_s = gap_m, speed_m_s, known_s

    def answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        now_s = time_ns / NS_PER_S
        if self.gap_m is None:
            return BridgeAnswer(time_ns, None, LeaderPreview.empty(), lost=False)
        times = now_s + np.arange(0.0, self.known_s + 1.0)
        places = host_position_m + self.gap_m + self.speed_m_s * (times - now_s)
        preview = LeaderPreview(now_s, times, places, np.full(times.size, self.speed_m_s))
        state = LeaderState(now_s, host_position_m + self.gap_m, self.speed_m_s)
        return BridgeAnswer(time_ns, state, preview, lost=False, predictor="history")


def rules(inner: Heard, signal: CyclicSignal, speed_m_s: float, **more: float) -> RulesOfTheRoad:
    return RulesOfTheRoad(
        inner, lambda: speed_m_s, GivenRules(LIMITS, SignalPlan((signal,))), PARAMETERS, **more
    )


def test_a_closed_line_is_a_leader_that_comes_to_stand_behind_it() -> None:
    answer = rules(Heard(None), CLOSED, 14.0).answer(0, 0.0)
    assert answer.predictor == "rules"
    assert answer.leader is not None
    assert answer.preview.times_s[-1] == 60.0
    # The host that keeps its standstill gap halts in front of the line.
    rear_m = 400.0 - STOP_BEFORE_M + GAP.standstill_gap_m
    assert answer.preview.positions_m[-1] == pytest.approx(rear_m)
    assert answer.preview.speeds_m_s[-1] == 0.0
    # It has begun to brake by 98 m before it, 14 m/s at 1 m/s^2, and not at once.
    assert answer.preview.speeds_m_s[15] == pytest.approx(14.0)
    assert 10.0 < answer.preview.speeds_m_s[24] < 13.0


def test_the_same_tick_again_has_the_same_answer() -> None:
    """A plant that is paused repeats its state; the leader that is not there must not drive on meanwhile."""
    keeping = rules(Heard(None), OPEN, 10.0)
    keeping.answer(0, 0.0)
    first, again, later = (keeping.answer(tick * NS_PER_S, 10.0) for tick in (1, 1, 2))
    assert again is first
    assert later.leader is not None
    fresh = rules(Heard(None), OPEN, 10.0)
    for tick, place_m in ((0, 0.0), (1, 10.0)):
        fresh.answer(tick * NS_PER_S, place_m)
    assert fresh.answer(2 * NS_PER_S, 10.0).leader == later.leader


def test_an_open_line_holds_nobody_and_the_speed_limit_stays() -> None:
    answer = rules(Heard(None), OPEN, 10.0).answer(0, 0.0)
    assert answer.predictor == "rules"
    assert answer.preview.positions_m[-1] > 800.0
    assert answer.preview.speeds_m_s.max() <= 14.0


def test_a_line_beyond_the_foresight_is_not_looked_at() -> None:
    answer = rules(Heard(None), CLOSED, 14.0, foresight_s=15.0).answer(0, 0.0)
    assert answer.preview.positions_m[-1] > 800.0


def test_a_leader_nearer_than_the_rules_is_left_as_it_is() -> None:
    inner = Heard(20.0)
    answer, heard = rules(inner, OPEN, 10.0).answer(0, 0.0), inner.answer(0, 0.0)
    assert answer.predictor == "history"
    assert answer.leader == heard.leader
    np.testing.assert_array_equal(answer.preview.positions_m, heard.preview.positions_m)


def test_a_leader_that_gets_through_does_not_lead_over_a_line_that_closes() -> None:
    # The leader passes 400 m after 38 s, the host would three seconds later; it closes after 40 s.
    answer = rules(Heard(20.0), CyclicSignal(400.0, 1000.0, -10.0, 50.0), 10.0).answer(0, 0.0)
    assert answer.leader is not None
    assert answer.leader.position_m == pytest.approx(20.0)
    assert answer.preview.positions_m[-1] == pytest.approx(403.0)


def test_of_a_leader_that_is_hardly_known_no_more_is_promised_than_the_worst() -> None:
    # 60 m ahead at 10 m/s it may halt 77 m on; the rules ahead of that are known only so far.
    answer = rules(Heard(60.0, 10.0, known_s=2.0), OPEN, 14.0).answer(0, 0.0)
    worst_m = 60.0 + 20.0 + 100.0 / 6.0
    halting_m = answer.preview.positions_m + answer.preview.speeds_m_s**2 / 4.0
    assert answer.preview.times_s[-1] < 60.0
    rules_lead = answer.preview.positions_m < 60.0 + 10.0 * answer.preview.times_s - 1e-6
    assert (halting_m[rules_lead] <= worst_m + 9.0).all()


class SeenPlant(Plant):
    """A plant that remembers its speed."""

    speed_m_s = 0.0

    def advance(self, *arguments: object, **more: object) -> PlantStep:
        step = super().advance(*arguments, **more)  # type: ignore[arg-type]
        self.speed_m_s = step.state.speed_m_s
        return step


@pytest.mark.parametrize(
    ("opens_at_s", "foresight_s"),
    [(0.0, 60.0), (12.0, 15.0), (24.0, 60.0), (36.0, 15.0), (48.0, 60.0)],
)
def test_the_controller_passes_lines_only_while_they_are_open(
    opens_at_s: float, foresight_s: float
) -> None:
    signals = tuple(
        CyclicSignal(line_m, 60.0, opens_at_s + shift_s, 25.0)
        for line_m, shift_s in ((300.0, 0.0), (700.0, 17.0), (1100.0, 41.0))
    )
    road = build_route("smooth", "flat", initial_gap_m=15.0, duration_s=150.0)
    plant = SeenPlant(PARAMETERS, road.slope.slope_at)
    plan = SignalPlan(signals)
    bridge = RulesOfTheRoad(
        Heard(None),
        lambda: plant.speed_m_s,
        GivenRules(LIMITS, plan),
        PARAMETERS,
        PreviewSettings(),
        foresight_s=foresight_s,
    )
    options = ControllerOptions(trip_duration_s=road.duration_s)
    run = run_closed_loop(road, plant, Controller(PARAMETERS, options), bridge=bridge).trajectory
    times, places = run.time_s, run.position_m
    passed = 0
    for signal in signals:
        if places[-1] > signal.stop_line_m:
            passed += 1
            index = int(np.argmax(places > signal.stop_line_m))
            share = (signal.stop_line_m - places[index - 1]) / (places[index] - places[index - 1])
            passed_s = float(times[index - 1] + share * (times[index] - times[index - 1]))
            assert signal.is_open(passed_s), f"{signal} was passed at {passed_s} s"
    assert passed >= 1

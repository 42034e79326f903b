"""Attacks on the receiver while it drives: what it makes of them, and what the car does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import datagram

from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.strategy import STRATEGIES
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam_codec import encode_cam
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import Foresight, Framing, SenderSettings
from iptm_v2x_bridge.simulated_radio import SimulatedRadio

NS = 10**9
ROAD = RoadLine.test_road()
PARAMETERS = load_parameters().values
BEGIN_S, END_S, TRIP_S = 25, 33, 45
SENDER = SenderSettings(framing=Framing.BARE, path_points=10)
LEADER = SENDER.station_id
FORGER = 666
SPEED_M_S = 12.0

Attack = Callable[[int, float], list[bytes]]
"""What is sent in a second of trip time, the host being where it is."""


@dataclass(frozen=True)
class Outcome:
    """A drive under attack and what the receiver made of it."""

    loop: ClosedLoopRun
    bridge: CamBridge
    leaders: list[int | None]
    refused: dict[str, int]

    def margins_m(self) -> np.ndarray:
        return gap_margins_m(self.loop.trajectory, PARAMETERS)


class AttackedRadio(SimulatedRadio):
    """The genuine messages of each second, then those of the attacker."""

    def __init__(self, route: Route, attack: Attack | None) -> None:
        bridge = CamBridge(ROAD)
        super().__init__(CamSender(route.leader, ROAD, SENDER), bridge)
        self._attack = attack
        self.leaders: list[int | None] = []

    def answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        second = time_ns // NS
        answer = super().answer(time_ns, host_position_m)
        if self._attack is not None and BEGIN_S <= second < END_S:
            for forged in self._attack(second, host_position_m):
                self.bridge.receive(forged, time_ns)
            answer = self.bridge.answer(time_ns, host_position_m)
        self.leaders.append(self.bridge.leader_id)
        return answer


@pytest.fixture(scope="module")
def route(tmp_path_factory: pytest.TempPathFactory) -> Route:
    """A leader that pulls away and drives 12 m/s."""
    file = tmp_path_factory.mktemp("road") / "steady.csv"
    file.write_text(f"time_s,speed_m_s\n0,0\n12,{SPEED_M_S}\n60,{SPEED_M_S}\n")
    gap_m = PARAMETERS.gap.initial_gap_m
    return build_route(str(file), initial_gap_m=gap_m, duration_s=TRIP_S)


@pytest.fixture(scope="module")
def drive(route: Route) -> Callable[[Attack | None], Outcome]:
    def run(attack: Attack | None) -> Outcome:
        radio = AttackedRadio(route, attack)
        options = ControllerOptions(strategy=STRATEGIES["aging"], horizon=MULTI_HORIZON)
        controller = Controller(PARAMETERS, options)
        plant = Plant(PARAMETERS, route.slope.slope_at)
        loop = run_closed_loop(route, plant, controller, bridge=radio)
        refused = radio.bridge.table.rejections.by_reason()
        return Outcome(loop, radio.bridge, radio.leaders, refused)

    return run


@pytest.fixture(scope="module")
def undisturbed(drive: Callable[[Attack | None], Outcome]) -> Outcome:
    outcome = drive(None)
    assert set(outcome.leaders) == {LEADER}
    assert outcome.refused == {}
    return outcome


def expect_untouched(outcome: Outcome, undisturbed: Outcome) -> None:
    """The car drives as if nothing had happened, to the last bit."""
    assert set(outcome.leaders) == {LEADER}
    np.testing.assert_array_equal(
        outcome.loop.trajectory.position_m, undisturbed.loop.trajectory.position_m
    )


def tenths(second: int) -> range:
    """The instants of the second up to a tick, ms."""
    return range(1000 * second - 900, 1000 * second + 1, 100)


def test_a_forged_car_close_ahead_is_believed_and_kept_clear_of(
    drive: Callable[[Attack | None], Outcome],
) -> None:
    """Without signatures nobody can tell it from a real one: the car brakes within its limits."""
    start: list[float] = []

    def attack(second: int, host_m: float) -> list[bytes]:
        start.append(host_m)
        origin = start[0] + 5.0 - SPEED_M_S * BEGIN_S
        return [
            datagram(FORGER, at_ms, origin + SPEED_M_S * at_ms / 1000.0, SPEED_M_S)
            for at_ms in tenths(second)
        ]

    outcome = drive(attack)
    assert FORGER in outcome.leaders[BEGIN_S : END_S + 1]
    assert outcome.leaders[-1] == LEADER
    run = outcome.loop.trajectory
    limits = PARAMETERS.limits
    assert run.acceleration_m_s2.min() >= limits.min_acceleration_m_s2 - 1e-6
    assert run.acceleration_m_s2[BEGIN_S:END_S].min() < -0.5
    assert run.gap_m.min() > 0.0
    assert outcome.margins_m()[BEGIN_S:].min() > 0.0


def test_replayed_messages_change_nothing(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome, route: Route
) -> None:
    """Recorded from the leader, and sent again seconds later."""
    recorded = CamSender(route.leader, ROAD, SENDER)

    def attack(second: int, _: float) -> list[bytes]:
        return [
            recorded.datagram_at((at_ms - late_ms) * 1_000_000)
            for late_ms in (0, 1500, 8000)
            for at_ms in tenths(second)
        ]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert set(outcome.refused) == {"duplicate", "older", "stale"}


def test_messages_replayed_a_whole_wrap_later_contradict_the_leader(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome, route: Route
) -> None:
    """Their time of generation looks new; the places do not fit."""
    recorded = CamSender(route.leader, ROAD, SENDER)

    def attack(second: int, _: float) -> list[bytes]:
        old = recorded.message_at((second - 15) * NS)
        return [encode_cam(replace(old, delta_time_ms=(1000 * second + 50) % 65_536))]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert set(outcome.refused) == {"position_jump", "speed_jump"}
    assert sum(outcome.refused.values()) == END_S - BEGIN_S


def test_a_station_that_jumps_between_lanes_leads_no_one(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome
) -> None:
    def attack(second: int, host_m: float) -> list[bytes]:
        return [
            datagram(FORGER, at_ms, host_m + 8.0, SPEED_M_S, 3.5 if at_ms % 200 else 0.0)
            for at_ms in tenths(second)
        ]

    outcome = drive(attack)
    assert outcome.refused["lateral_jump"] + outcome.refused["position_jump"] >= END_S - BEGIN_S
    expect_untouched(outcome, undisturbed)


def test_absurd_speeds_are_refused(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome
) -> None:
    def attack(second: int, host_m: float) -> list[bytes]:
        return [datagram(FORGER, at_ms, host_m + 8.0, 120.0) for at_ms in tenths(second)]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert outcome.refused == {"absurd": 10 * (END_S - BEGIN_S)}


def test_ten_thousand_stations_at_once_do_no_harm(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome
) -> None:
    def attack(second: int, host_m: float) -> list[bytes]:
        if second != BEGIN_S:
            return []
        return [
            datagram(10_000 + number, 1000 * second, host_m + 6.0, SPEED_M_S)
            for number in range(10_000)
        ]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert outcome.refused["table_full"] > 5000


def test_a_second_sender_with_the_leaders_identity_is_not_followed(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome
) -> None:
    def attack(second: int, host_m: float) -> list[bytes]:
        return [
            datagram(LEADER, at_ms + 50, host_m + 5.0, 0.0) for at_ms in tenths(second)[:-1]
        ] + [datagram(LEADER, 1000 * second + 50, host_m + 5.0, 0.0)]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert sum(outcome.refused.values()) == 10 * (END_S - BEGIN_S)


def test_a_leader_whose_clock_is_set_back_is_dropped_and_found_again(
    drive: Callable[[Attack | None], Outcome], undisturbed: Outcome, route: Route
) -> None:
    """A genuine message with a time just past blocks nothing: later genuine ones go on being used."""
    recorded = CamSender(route.leader, ROAD, SENDER)

    def attack(second: int, _: float) -> list[bytes]:
        now = recorded.message_at(second * NS)
        return [
            encode_cam(replace(now, delta_time_ms=(1000 * second - back_ms) % 65_536))
            for back_ms in (100, 2500, 30_000)
        ]

    outcome = drive(attack)
    expect_untouched(outcome, undisturbed)
    assert outcome.refused == {
        "older": 2 * (END_S - BEGIN_S),
        "stale": END_S - BEGIN_S,
    }


class SilencedRadio(SimulatedRadio):
    """Nothing is heard any more from a second of trip time on: jammed, or out of reach."""

    def answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        if time_ns >= BEGIN_S * NS:
            return self.bridge.answer(time_ns, host_position_m)
        return super().answer(time_ns, host_position_m)


def test_a_leader_that_falls_silent_and_brakes_is_not_run_into(tmp_path: Path) -> None:
    """The leader brakes to a halt unheard; the host halts behind where it may be by then."""
    file = tmp_path / "halts.csv"
    file.write_text("time_s,speed_m_s\n0,0\n12,14\n26,14\n32,0\n75,0\n")
    gap_m = PARAMETERS.gap.initial_gap_m
    route = build_route(str(file), initial_gap_m=gap_m, duration_s=75)
    settings = replace(SENDER, foresight=Foresight.NONE)
    radio = SilencedRadio(CamSender(route.leader, ROAD, settings), CamBridge(ROAD))
    options = ControllerOptions(strategy=STRATEGIES["aging"], horizon=MULTI_HORIZON)
    plant = Plant(PARAMETERS, route.slope.slope_at)
    loop = run_closed_loop(route, plant, Controller(PARAMETERS, options), bridge=radio)
    assert loop.trajectory.gap_m.min() > 0.0
    assert loop.trajectory.speed_m_s[-1] < 0.5

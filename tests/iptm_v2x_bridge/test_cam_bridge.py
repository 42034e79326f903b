"""The bridge of received messages: leader, preview, bounds, silence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import ROAD
from tests.iptm_v2x_bridge.radio import datagram as datagram_of

from iptm_core.routes import Route
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Foresight, Framing, SenderSettings

NS = 10**9


def radio(
    route: Route, preview: PreviewSettings | None = None, start_ms: int = 0, **settings: object
) -> SimulatedRadio:
    sender = CamSender(route.leader, ROAD, SenderSettings(**settings), start_ms)  # type: ignore[arg-type]
    return SimulatedRadio(sender, CamBridge(ROAD, preview, start_timestamp_ms=start_ms))


def answers(wireless: SimulatedRadio, route: Route, ticks: range) -> list[BridgeAnswer]:
    """Answers to an ego vehicle that follows 10 m behind."""
    return [
        wireless.answer(tick * NS, float(route.leader.positions_at(float(tick))) - 10.0)
        for tick in ticks
    ]


@pytest.mark.parametrize("framing", list(Framing))
@pytest.mark.parametrize("start_ms", [0, 65_536 * 10_000_000 - 3_000])
def test_the_leader_is_known_from_its_messages(
    route: Route, framing: Framing, start_ms: int
) -> None:
    wireless = radio(route, framing=framing, start_ms=start_ms)
    for tick, answer in enumerate(answers(wireless, route, range(60))):
        truth = route.leader.state_at(float(tick))
        assert answer.leader is not None
        assert answer.predictor == "received_path"
        assert answer.leader.time_s == tick
        assert -0.4 < answer.leader.position_m - truth.position_m <= 0.0
        assert answer.leader.speed_m_s == pytest.approx(truth.speed_m_s, abs=0.01)
        assert answer.preview.generated_at_s == tick
        assert answer.preview.times_s[-1] == tick + 60.0
        expected = route.leader.positions_at(answer.preview.times_s)
        errors_m = answer.preview.positions_m - expected
        assert np.abs(errors_m).max() < 1.5
        assert np.abs(errors_m[:20]).max() < 0.6
        assert errors_m[:20].max() <= 0.02
    assert wireless.bridge.leader_id == 4711


def test_without_foresight_little_is_claimed_to_be_known(route: Route) -> None:
    for answer in answers(radio(route, foresight=Foresight.NONE), route, range(60)):
        assert answer.predictor == "history"
        now_s = answer.time_ns / NS
        # The leader may brake as hard as the ego vehicle from the first node on.
        assert answer.preview.known_until_s - now_s == 1.0
        # What is expected reaches farther.
        assert answer.preview.times_s[-1] - now_s == 60.0
        assert (np.diff(answer.preview.bounds_m) > 0.0).all()


@pytest.mark.parametrize("foresight", list(Foresight))
def test_position_accuracy_shifts_the_leader_and_nothing_else(
    route: Route, foresight: Foresight
) -> None:
    exact, stated = (
        list(
            answers(
                radio(route, foresight=foresight, position_accuracy_m=accuracy_m), route, range(60)
            )
        )
        for accuracy_m in (0.02, 8.5)
    )
    for one, other in zip(exact, stated, strict=True):
        assert one.leader is not None
        assert other.leader is not None
        assert one.leader.position_m - other.leader.position_m == pytest.approx(8.48)
        assert one.leader.speed_m_s == other.leader.speed_m_s
        assert other.leader_bound_m - one.leader_bound_m == pytest.approx(8.48)
        assert one.preview.known_until_s == other.preview.known_until_s
        np.testing.assert_array_equal(one.preview.speeds_m_s, other.preview.speeds_m_s)
        np.testing.assert_allclose(
            one.preview.positions_m - other.preview.positions_m, 8.48, atol=1e-6
        )
        np.testing.assert_allclose(one.preview.bounds_m, other.preview.bounds_m, atol=1e-6)


@pytest.mark.parametrize("foresight", list(Foresight))
@pytest.mark.parametrize("delay_s", [0.3, 1.0])
def test_a_late_message_keeps_its_time_of_generation(
    route: Route, foresight: Foresight, delay_s: float
) -> None:
    wireless = radio(route, foresight=foresight, link_delay_s=delay_s)
    for answer in answers(wireless, route, range(20, 80)):
        assert answer.preview_age_s == pytest.approx(delay_s)
        truth = route.leader.state_at(answer.time_ns / NS)
        assert answer.leader is not None
        assert answer.leader.position_m <= truth.position_m + 0.6


def test_losses_do_not_lower_the_speed_of_the_leader(route: Route) -> None:
    """A speed that swings with the age of the messages looks like wrong previews to the controller."""
    lossy = {"foresight": Foresight.NONE, "loss_probability": 0.5, "link_delay_s": 1.0}
    no_preview = PreviewSettings(preview_mode=PreviewMode.NONE)
    lowered_m_s = []
    for answer, without in zip(
        answers(radio(route, **lossy), route, range(20, 80)),
        answers(radio(route, no_preview, **lossy), route, range(20, 80)),
        strict=True,
    ):
        assert answer.leader is not None
        assert without.leader is not None
        _, (expected_m_s,) = answer.preview.at(np.array([answer.leader.time_s]))
        assert answer.leader.speed_m_s == pytest.approx(expected_m_s)
        assert without.leader.position_m == answer.leader.position_m
        lowered_m_s.append(answer.leader.speed_m_s - without.leader.speed_m_s)
    # Without the bounds of a preview the speed itself has to be cautious.
    assert min(lowered_m_s) >= 0.0
    assert max(lowered_m_s) > 0.5


def test_losses_make_the_leader_older_and_nearer(route: Route) -> None:
    """What is not heard for long is taken to be nearer, never farther."""
    wireless = radio(
        route, foresight=Foresight.NONE, rate_hz=1.0, loss_probability=0.5, sender_seed=3
    )
    found = [answer for answer in answers(wireless, route, range(5, 300)) if answer.leader]
    bounds = {round(answer.preview_age_s): answer.leader_bound_m for answer in found}
    assert bounds[0] < bounds[1]
    assert {answer.predictor for answer in found} == {"history", "assumed_braking"}
    ahead = [
        answer.leader.position_m - float(route.leader.positions_at(answer.time_ns / NS))
        for answer in found
        if answer.leader
    ]
    assert np.mean(np.array(ahead) > 0.02) < 0.06


def test_a_leader_that_falls_silent_is_taken_to_come_to_a_halt(route: Route) -> None:
    """It leads on, nearer and slower the longer it is not heard, and never drives backwards."""
    wireless = radio(route, foresight=Foresight.NONE)
    answers(wireless, route, range(70))
    ego_m = float(route.leader.positions_at(69.0)) - 20.0
    silent = [wireless.bridge.answer(tick * NS, ego_m) for tick in range(70, 129)]
    places = np.array([answer.leader.position_m for answer in silent if answer.leader])
    speeds = np.array([answer.leader.speed_m_s for answer in silent if answer.leader])
    assert places.size == 59
    # It is taken nearer when it counts as silent, after a second and a half; then it moves on to its halt.
    assert places[1] > places[0] - 1.0
    assert (np.diff(places[1:]) >= 0.0).all()
    assert places[-1] - places[0] < 100.0
    assert speeds[10:].max() == 0.0
    assert wireless.bridge.leader_id == 4711
    assert wireless.bridge.answer(135 * NS, ego_m).leader is None


def test_a_leader_that_is_heard_again_leads_at_once(route: Route) -> None:
    """Also under another identity, as privacy has it change."""
    wireless = radio(route, foresight=Foresight.NONE)
    answers(wireless, route, range(40))
    for tick in range(40, 50):
        wireless.bridge.answer(tick * NS, 10.0)
    renamed = CamSender(route.leader, ROAD, SenderSettings(station_id=99))
    for _, datagram in renamed.arrivals(50 * NS, 52 * NS):
        wireless.bridge.receive(datagram, 52 * NS)
    answer = wireless.bridge.answer(52 * NS, float(route.leader.positions_at(52.0)) - 10.0)
    assert wireless.bridge.leader_id == 99
    assert answer.leader is not None
    assert answer.leader.position_m == pytest.approx(
        float(route.leader.positions_at(52.0)), abs=0.4
    )


def test_no_leader_is_no_leader() -> None:
    bridge = CamBridge(ROAD)
    answer = bridge.answer(0, 0.0)
    assert answer.leader is None
    assert answer.preview_age_s == math.inf
    assert bridge.report()["leader_station"] == "none"


def test_the_choice_of_no_preview_leaves_the_leader(route: Route) -> None:
    wireless = radio(route, PreviewSettings(preview_mode=PreviewMode.NONE))
    (answer,) = answers(wireless, route, range(10, 11))
    assert answer.leader is not None
    assert answer.preview.times_s.size == 0


def test_time_set_back_begins_a_new_trip(route: Route) -> None:
    wireless = radio(route)
    before = answers(wireless, route, range(20))
    again = answers(wireless, route, range(20))
    assert [answer.leader for answer in before] == [answer.leader for answer in again]
    assert not wireless.bridge.table.rejections.total


def test_everything_dropped_is_reported(route: Route) -> None:
    wireless = radio(route)
    answers(wireless, route, range(5))
    wireless.bridge.receive(b"noise", 5 * NS)
    wireless.bridge.count_overflow(7)
    report = wireless.bridge.report()
    assert report["rejected_size"] == 1
    assert report["rejected_overflow"] == 7
    assert report["leader_station"] == 4711
    assert report["predictor"] == "received_path"


def test_jitter_reorders_and_loses_nothing_else(route: Route) -> None:
    """Overtaken messages are dropped as older; all others are used."""
    wireless = radio(route, link_jitter_s=0.5, sender_seed=2, foresight=Foresight.NONE)
    for tick in range(60):
        wireless.answer(tick * NS, 10.0)
    reasons = wireless.bridge.table.rejections.by_reason()
    assert set(reasons) <= {"older", "stale"}
    assert reasons["older"] > 10


def test_a_late_tick_is_answered_for_its_own_time() -> None:
    """Two seconds late: the messages of the leader since then are known, but not its positions before."""
    late, punctual = CamBridge(ROAD), CamBridge(ROAD)
    for time_ms in range(0, 5001, 100):
        message = datagram_of(4711, time_ms, 50.0 + 0.012 * time_ms, 12.0)
        assert late.receive(message, time_ms * 10**6) is None
        if time_ms <= 3000:
            assert punctual.receive(message, time_ms * 10**6) is None
    answer, expected = late.answer(3 * NS, 36.0), punctual.answer(3 * NS, 36.0)
    assert answer.leader == expected.leader
    np.testing.assert_array_equal(answer.preview.positions_m, expected.preview.positions_m)


@pytest.mark.parametrize("foresight", list(Foresight))
@pytest.mark.parametrize("ahead_ms", [-500, -50, 1, 500])
def test_the_leader_is_not_taken_to_be_farther_on_by_the_clock_of_its_sender(
    route: Route, foresight: Foresight, ahead_ms: int
) -> None:
    settings = SenderSettings(foresight=foresight)
    sender = CamSender(route.leader, ROAD, settings, 10_000 + ahead_ms)
    wireless = SimulatedRadio(sender, CamBridge(ROAD, start_timestamp_ms=10_000))
    ticks, held = range(2, 200), 0
    for answer in answers(wireless, route, range(200))[ticks.start :]:
        assert answer.leader is not None
        truth = route.leader.state_at(answer.time_ns / NS)
        held += answer.leader.position_m <= truth.position_m + 0.02
    assert held >= 0.99 * len(ticks)

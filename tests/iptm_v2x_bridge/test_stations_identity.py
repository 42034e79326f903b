"""Two senders with one identity, and what only looks like it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from studies.v2x.impostor import ContestedSender, Impostor
from tests.iptm_v2x_bridge.radio import ROAD, station

from iptm_core.routes.cycles import LeaderMotion
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import CamMessage
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Foresight, Framing, SenderSettings
from iptm_v2x_bridge.stations.table import STATION_TIMEOUT_MS, StationTable

NS = 10**9
NOW_MS = 700_000_000_000
DEPARTURE_S = 4
MOTION = LeaderMotion(
    np.array([-20.0, 0.0, DEPARTURE_S, DEPARTURE_S + 6.0]), np.array([15.0, 15.0, 15.0, 0.0]), 0.0
)
"""A leader at 15 m/s that brakes to a halt with 2.5 m/s2."""

CLOCKS = {
    "100 ms ahead": (Impostor(DEPARTURE_S, clock_ahead_s=0.1), 0.0),
    "150 ms ahead, later": (Impostor(DEPARTURE_S, clock_ahead_s=0.15, delay_s=0.05), 0.0),
    "equal, first": (Impostor(DEPARTURE_S, delay_s=-0.01), 0.02),
    "equal, later": (Impostor(DEPARTURE_S), 0.0),
    "20 ms ahead": (Impostor(DEPARTURE_S, clock_ahead_s=0.02), 0.0),
    "50 ms behind": (Impostor(DEPARTURE_S, clock_ahead_s=-0.05), 0.0),
    "100 ms behind, first": (Impostor(DEPARTURE_S, clock_ahead_s=-0.1, delay_s=-0.01), 0.02),
}
"""Impostors by their stamps, and the delay (s) of the messages of both."""


def answers(
    bridge: CamBridge, settings: SenderSettings, impostor: Impostor, ticks: int
) -> Iterator[BridgeAnswer]:
    """Yield the answers to an ego vehicle 25 m behind the leader; datagrams count when they arrive."""
    sender = ContestedSender(MOTION, ROAD, settings, impostor)
    after_ns = -(10**12)
    for tick in range(ticks):
        for arrival_ns, datagram in sender.arrivals(after_ns, tick * NS):
            bridge.receive(datagram, max(arrival_ns, -3 * NS))
        after_ns = tick * NS
        yield bridge.answer(after_ns, float(MOTION.positions_at(float(tick))) - 25.0)


@pytest.mark.parametrize(
    ("drifts", "foresight"),
    [(False, Foresight.NONE), (False, Foresight.PATH), (True, Foresight.NONE)],
)
@pytest.mark.parametrize("clock", CLOCKS)
def test_the_nearer_of_two_senders_leads(clock: str, drifts: bool, foresight: Foresight) -> None:
    """From the first tick after the two part, whichever of them is heard first."""
    settings = SenderSettings(
        framing=Framing.BARE,
        foresight=foresight,
        path_points=10,
        link_delay_s=CLOCKS[clock][1],
    )
    bridge, impostor = CamBridge(ROAD), replace(CLOCKS[clock][0], drifts_aside=drifts)
    for answer in answers(bridge, settings, impostor, DEPARTURE_S + 6):
        time_s = answer.time_ns / NS
        if time_s <= DEPARTURE_S:
            continue
        truth = MOTION.state_at(time_s)
        assert answer.contested
        assert answer.leader is not None
        assert answer.leader.position_m <= truth.position_m + 0.02
        assert answer.leader.speed_m_s <= truth.speed_m_s + 0.15
        assert answer.predictor != "received_path"
    assert str(bridge.report()["contested_stations"]).startswith("4711 since ")


def test_the_contest_ends_when_one_of_the_two_falls_silent() -> None:
    settings = SenderSettings(foresight=Foresight.PATH, path_points=10)
    bridge = CamBridge(ROAD)
    *_, last = answers(bridge, replace(settings, path_period_s=60.0), Impostor(0.0), 12)
    assert last.contested
    sender, end_s = CamSender(MOTION, ROAD, settings), 11 + STATION_TIMEOUT_MS // 1000
    for tick in range(12, end_s + 2):
        for arrival_ns, datagram in sender.arrivals((tick - 1) * NS, tick * NS):
            bridge.receive(datagram, arrival_ns)
        last = bridge.answer(tick * NS, float(MOTION.positions_at(float(tick))) - 25.0)
        assert last.contested == (tick < end_s)
    assert last.predictor == "received_path"
    assert bridge.report()["contested_stations"] == "none"


def received(
    table: StationTable, timed: list[tuple[float, int, CamMessage]]
) -> list[Rejection | None]:
    """Let messages arrive: instant of arrival and time of generation in ms, and the message."""
    return [
        table.receive(message, None, NOW_MS + round(arrival_ms))
        for arrival_ms, _, message in sorted(timed, key=lambda entry: entry[:2])
    ]


def car(at_ms: int, off_m: float = 0.0, left_m: float = 0.0, **more: float) -> CamMessage:
    """Return what a car at 20 m/s says, some metres off its way."""
    return station(7, NOW_MS + at_ms, 100.0 + 0.02 * at_ms + off_m, 20.0, left_m, **more)


Genuine = Callable[[np.random.Generator], list[tuple[float, int, CamMessage]]]
TIMES_MS = range(0, 40_000, 100)


def twice(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """Every message on two ways, the second one up to a second later."""
    late_ms = random.uniform(0.0, 1000.0, len(TIMES_MS))
    once = [(float(at_ms), at_ms, car(at_ms)) for at_ms in TIMES_MS]
    return once + [
        (at_ms + late, at_ms, message)
        for (_, at_ms, message), late in zip(once, late_ms, strict=True)
    ]


def overtaken(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """Delays of 0.3 s in the mean."""
    late_ms = 300.0 * random.exponential(size=len(TIMES_MS))
    return [(ms + late, ms, car(ms)) for ms, late in zip(TIMES_MS, late_ms, strict=True)]


def tunnel(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """A position 40 m off for a second, twice within five, with delays of 0.1 s in the mean."""
    late_ms = 100.0 * random.exponential(size=len(TIMES_MS))
    return [
        (ms + late, ms, car(ms, 40.0 if 20_000 <= ms < 21_000 or 24_000 <= ms < 25_000 else 0.0))
        for ms, late in zip(TIMES_MS, late_ms, strict=True)
    ]


def jumped(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """A position 20 m off from an instant on, some messages twice."""
    late_ms = 100.0 * random.exponential(size=len(TIMES_MS))
    once = [
        (ms + late, ms, car(ms, -20.0 if ms > 20_000 else 0.0))
        for ms, late in zip(TIMES_MS, late_ms, strict=True)
    ]
    return once + [(arrival_ms + 150.0, ms, message) for arrival_ms, ms, message in once[::3]]


def single_errors(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """One position of a hundred is 25 m off."""
    return [
        (float(ms), ms, car(ms, 25.0 if wrong else 0.0))
        for ms, wrong in zip(TIMES_MS, random.random(len(TIMES_MS)) < 0.01, strict=True)
    ]


def noise(random: np.random.Generator) -> list[tuple[float, int, CamMessage]]:
    """The noise of a receiver that states an ellipse of 2.82 m; delays of 50 ms in the mean."""
    off_m, left_m = np.zeros(len(TIMES_MS)), np.zeros(len(TIMES_MS))
    for error_m in (off_m, left_m):
        for number in range(1, error_m.size):  # 1.15 m, correlated over 10 s
            error_m[number] = 0.99 * error_m[number - 1] + 0.162 * random.normal()
    late_ms = 50.0 * random.exponential(size=len(TIMES_MS))
    return [
        (ms + late, ms, car(ms, off, left, position_bound_m=2.82))
        for ms, late, off, left in zip(TIMES_MS, late_ms, off_m, left_m, strict=True)
    ]


@pytest.mark.parametrize("genuine", [twice, overtaken, tunnel, jumped, single_errors, noise])
def test_one_sender_is_never_taken_for_two(genuine: Genuine) -> None:
    table = StationTable(ROAD)
    timed = sorted(genuine(np.random.default_rng(1)), key=lambda entry: entry[:2])
    for arrival_ms, _, message in timed:
        table.receive(message, None, NOW_MS + round(arrival_ms))
        assert table.contested_since_ms == {}
    (known,) = table.hypotheses(7)
    last_ms, message = timed[-1][1:]
    assert known.last.moved_on_m((NOW_MS + last_ms) / 1000.0) == pytest.approx(
        station_position_m(message), abs=2.5
    )


def station_position_m(message: CamMessage) -> float:
    fix = ROAD.project(message.latitude_deg, message.longitude_deg)
    return fix.position_m - message.front_to_rear_m


def test_the_clock_of_a_station_is_measured() -> None:
    """What is ahead of it by more than 50 ms is not of this station, unless nothing else is heard."""
    table = StationTable(ROAD)
    received(table, [(ms + 0.0, ms, car(ms)) for ms in range(0, 2000, 100)])
    assert received(table, [(2000.0, 2150, car(2150))]) == [Rejection.FUTURE]
    assert received(table, [(2000.0, 2040, car(2040))]) == [None]
    assert received(table, [(3100.0, 3250, car(3250))]) == [None]


def test_a_clock_that_is_ahead_stays_so() -> None:
    table = StationTable(ROAD)
    ahead = [(ms - 150.0, ms, car(ms)) for ms in range(150, 10_000, 100)]
    assert set(received(table, ahead)) == {None}


def test_noise_between_two_messages_does_not_hide_the_true_sender() -> None:
    """Twenty positions anywhere after each of its messages."""
    table, random = StationTable(ROAD), np.random.default_rng(5)
    received(table, [(ms + 0.0, ms, car(ms)) for ms in range(0, 1000, 100)])
    for ms in range(1000, 2000, 100):
        # The impostor is first and 30 m farther by now; its stamps leave no room for the true ones.
        received(table, [(ms + 0.0, ms, car(ms, 0.04 * (ms - 900))), (ms + 1.0, ms, car(ms))])
        for off_m in random.uniform(-200.0, 400.0, 20):
            received(table, [(ms + 2.0, ms, car(ms, off_m))])
    assert 7 in table.contested_since_ms
    rears_m = [known.last.position_m for known in table.hypotheses(7)]
    assert min(abs(rear_m - 138.0) for rear_m in rears_m) < 0.1

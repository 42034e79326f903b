from __future__ import annotations

import pytest

from iptm_ros.recording.subscriptions import (
    PATIENCE_ALONE_S,
    PATIENCE_INCOMPLETE_S,
    SETTLE_S,
    PeerGate,
)

GATE = ["/plant/odometry", "/clock"]
OTHERS = ["/plant/powers", "/controller/command"]
AWAITED = {
    **dict.fromkeys([*GATE, "/plant/powers"], "plant"),
    **dict.fromkeys(["/controller/command", "/controller/solve"], "controller"),
}


@pytest.fixture
def gate() -> PeerGate:
    return PeerGate(GATE, AWAITED)


def test_holds_back_only_its_own_topics(gate: PeerGate) -> None:
    assert [gate.holds(topic) for topic in (*GATE, *OTHERS)] == [True, True, False, False]


def test_opens_a_moment_after_the_suite_is_complete(gate: PeerGate) -> None:
    assert not gate.is_open(0.0, GATE, OTHERS[:1])
    complete = [*OTHERS, "/controller/solve"]
    assert not gate.is_open(5.0, GATE, complete)
    assert not gate.is_open(5.0 + 0.5 * SETTLE_S, GATE, complete)
    assert gate.is_open(5.0 + 1.01 * SETTLE_S, GATE, complete)


def test_opens_soon_for_a_controller_that_does_not_publish_every_topic(gate: PeerGate) -> None:
    assert not gate.is_open(0.0, GATE, OTHERS)
    assert not gate.is_open(0.9 * PATIENCE_ALONE_S, GATE, OTHERS)
    assert gate.is_open(PATIENCE_ALONE_S, GATE, OTHERS)


def test_waits_for_a_slow_controller_but_not_for_ever(gate: PeerGate) -> None:
    assert not gate.is_open(0.0, GATE, OTHERS[:1])
    assert not gate.is_open(0.9 * PATIENCE_INCOMPLETE_S, GATE, OTHERS[:1])
    assert gate.is_open(PATIENCE_INCOMPLETE_S, GATE, OTHERS[:1])


def test_running_trip_opens_at_once(gate: PeerGate) -> None:
    assert not gate.is_open(0.0, GATE, OTHERS[:1])
    gate.is_running = True
    assert gate.is_open(0.0, GATE, OTHERS[:1])


def test_without_the_rest_of_the_suite_it_opens_soon(gate: PeerGate) -> None:
    """For instance the clock of another simulator, or a replay of the odometry alone."""
    assert not gate.is_open(0.0, [], [])
    assert not gate.is_open(100.0, [], [])
    assert not gate.is_open(101.0, ["/clock"], [])
    assert gate.is_open(101.1 + PATIENCE_ALONE_S, ["/clock"], [])


def test_selection_without_other_topics_opens_at_once() -> None:
    gate = PeerGate(GATE, {"/clock": "plant"})
    assert not gate.is_open(0.0, ["/clock"], [])
    assert gate.is_open(SETTLE_S, ["/clock"], [])

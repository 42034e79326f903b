from __future__ import annotations

import math

import numpy as np

from iptm_core.state import LeaderPreview
from iptm_v2x_bridge.imperfections import age_s
from iptm_v2x_bridge.receiver import RadioLink, Receiver, empty_preview


def made_at(generated_at_s: float) -> LeaderPreview:
    times = generated_at_s + np.arange(3.0)
    return LeaderPreview(generated_at_s, times, times, np.ones(3))


def test_nothing_received_is_an_empty_preview_of_infinite_age() -> None:
    latest = Receiver().latest
    assert latest.times_s.size == latest.positions_m.size == latest.speeds_m_s.size == 0
    assert age_s(latest, 100.0) == math.inf


def test_latest_is_held_untouched_while_it_ages() -> None:
    receiver = Receiver()
    preview = made_at(3.0)
    receiver.receive(preview)
    assert receiver.latest is preview
    assert age_s(receiver.latest, 10.5) == 7.5


def test_older_prediction_never_replaces_a_newer_one() -> None:
    receiver = Receiver()
    newer = made_at(5.0)
    receiver.receive(newer)
    receiver.receive(made_at(4.0))
    receiver.receive(empty_preview())
    assert receiver.latest is newer


def test_link_delivers_after_the_latency_and_only_once() -> None:
    link = RadioLink(latency_ns=1500)
    first, second = made_at(0.0), made_at(1.0)
    link.send(0, first)
    link.send(1000, second)
    assert link.deliver(1499) == []
    assert link.deliver(1500) == [first]
    assert link.deliver(2500) == [second]
    assert link.deliver(10**6) == []


def test_link_without_latency_delivers_at_once() -> None:
    link = RadioLink(latency_ns=0)
    preview = made_at(0.0)
    link.send(7, preview)
    assert link.deliver(7) == [preview]

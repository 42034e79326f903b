"""The vehicle ahead by its messages: beside a measured one the nearer and slower counts, if it can be."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.radio_lead import RadioLead
from iptm_core.state import LeaderPreview, LeaderState


def preview(time_s: float, position_m: float, speed_m_s: float) -> LeaderPreview:
    elapsed = np.arange(5.0)
    return LeaderPreview(time_s + elapsed, position_m + speed_m_s * elapsed, np.full(5, speed_m_s))


def lead(preview_: LeaderPreview, time_s: float) -> RadioLead:
    found = RadioLead.of(preview_, time_s)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("measured", "counts"),
    [
        ((100.0, 20.0), (100.0, 20.0)),
        ((103.9, 22.9), (103.9, 22.9)),
        ((104.1, 19.0), (100.0, 19.0)),
        ((104.1, 22.0), (100.0, 20.0)),
        ((101.0, 23.1), (101.0, 20.0)),
        ((80.0, 10.0), (80.0, 10.0)),
    ],
)
def test_the_nearer_and_slower_one_counts(measured, counts):
    radio = lead(preview(10.0, 100.0, 20.0), 10.0)
    found = radio.nearer_and_slower(LeaderState(10.0, *measured))
    assert (found.position_m, found.speed_m_s) == counts
    samples = LeaderPreview(np.array([10.0]), np.array([measured[0]]), np.array([measured[1]]))
    assert radio.agrees_with(samples) is (measured == counts)


def test_an_old_message_allows_for_what_the_vehicle_has_gained():
    radio = lead(preview(9.0, 80.0, 20.0), 10.0)
    assert radio.at(10.5) == LeaderState(10.5, 110.0, 20.0)
    accelerated = LeaderState(10.5, 110.0 + 0.5 * 3.0 * 1.5**2, 24.5)  # 3 m/s^2 for 1.5 s
    assert radio.nearer_and_slower(accelerated) is accelerated
    assert RadioLead.of(preview(8.4, 70.0, 20.0), 10.0) is None
    assert RadioLead.of(preview(10.1, 100.0, 20.0), 10.0) is None
    assert RadioLead.of(LeaderPreview.empty(), 10.0) is None


def test_messages_that_contradict_each_other_do_not_follow():
    first = lead(preview(10.0, 100.0, 20.0), 10.0)
    assert lead(preview(11.0, 120.5, 21.0), 11.0).follows(first)
    assert lead(preview(11.0, 112.0, 4.0), 11.0).follows(first)  # it has braked
    assert not lead(preview(11.0, 100.0, 20.0), 11.0).follows(first)  # repeated
    assert not lead(preview(11.0, 105.0, 20.0), 11.0).follows(first)  # 15 m nearer at once
    assert not first.follows(first)

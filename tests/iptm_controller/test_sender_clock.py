"""A sender's clock that is ahead is put right; one that was never set is left to be refused."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_controller.lead_check import FORGOTTEN_AFTER_S, LARGEST_OFFSET_S, SenderClock
from iptm_core.state import LeaderPreview


def preview(generated_s: float) -> LeaderPreview:
    times = generated_s + np.arange(4.0)
    return LeaderPreview(times, 20.0 * times, np.full(4, 20.0))


def test_previews_that_are_not_from_the_future_stay_as_they_are() -> None:
    clock = SenderClock()
    for received in (preview(10.0), preview(7.0), LeaderPreview.empty()):
        assert clock.by_own_clock(received, 10.0) is received


@pytest.mark.parametrize("ahead_s", [0.001, 0.2, LARGEST_OFFSET_S])
def test_a_preview_from_the_future_is_of_now(ahead_s: float) -> None:
    received = preview(10.0 + ahead_s)
    put_right = SenderClock().by_own_clock(received, 10.0)
    assert put_right.times_s == pytest.approx(10.0 + np.arange(4.0))
    assert np.array_equal(put_right.positions_m, received.positions_m)


def test_the_offset_counts_for_later_previews_and_grows_to_what_the_fastest_one_showed() -> None:
    clock = SenderClock()
    clock.by_own_clock(preview(10.1), 10.0)
    clock.by_own_clock(preview(11.3), 11.0)
    assert clock.by_own_clock(preview(12.1), 12.0).generated_at_s == pytest.approx(11.8)
    assert clock.memory.ahead_s == pytest.approx(0.3)
    later_s = 12.0 + FORGOTTEN_AFTER_S
    assert clock.by_own_clock(preview(later_s), later_s).generated_at_s == later_s
    clock.by_own_clock(preview(later_s + 0.2), later_s)
    assert clock.by_own_clock(preview(0.0), 0.0).generated_at_s == 0.0, "another trip"


def test_a_clock_that_was_never_set_is_not_put_right() -> None:
    received = preview(10.0 + LARGEST_OFFSET_S + 0.01)
    assert SenderClock().by_own_clock(received, 10.0) is received
    clock = SenderClock()
    clock.by_own_clock(preview(9.1), 9.0)
    assert clock.by_own_clock(received, 10.0) is received, "whatever has shown before"

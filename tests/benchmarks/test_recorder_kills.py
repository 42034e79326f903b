"""Two kills of the campaign."""

from __future__ import annotations

import pytest
from benchmarks import recorder_kills


@pytest.mark.integration
def test_a_killed_recorder_loses_at_most_one_tick() -> None:
    outcome = recorder_kills.run(kills=2, seed=5)
    assert outcome.failures == []
    assert outcome.kills == len(outcome.lost_ticks) == 2

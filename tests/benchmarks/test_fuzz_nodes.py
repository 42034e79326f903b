"""A short fuzzing of the three nodes; `scripts/benchmark fuzz_nodes` has the long one."""

from __future__ import annotations

import pytest
from benchmarks.fuzz_nodes import ORDINARY_TICKS, measure

MESSAGES = 4000


@pytest.mark.integration
def test_no_damaged_message_ends_or_deafens_a_node() -> None:
    numbers = measure(messages=MESSAGES, seed=7)
    assert numbers["exceptions"] == 0, numbers["last_exception"]
    assert numbers["trip_ticks"] >= 2 * ORDINARY_TICKS
    assert sum(numbers["kinds"].values()) == MESSAGES
    assert len(numbers["kinds"]) == 7

"""No full collection of garbage while a trip is driven."""

from __future__ import annotations

import gc

import pytest

from iptm_core.program import no_full_collections


class Cycle:
    def __init__(self) -> None:
        self.own = self


def full_collections(count: int) -> int:
    """Make garbage that only the collector frees, and return the full collections meanwhile."""
    before = gc.get_stats()[2]["collections"]
    kept = [Cycle() for _ in range(count)]
    del kept
    return int(gc.get_stats()[2]["collections"] - before)


def test_full_collections_wait_for_the_end() -> None:
    thresholds = gc.get_threshold()
    gc.set_threshold(10, 2, 1)
    try:
        gc.freeze()
        gc.collect()  # with few objects left, the little that is made here makes a full collection due
        with no_full_collections():
            assert full_collections(20_000) == 0
        assert gc.get_threshold() == (10, 2, 1)
        assert full_collections(20_000) > 0
    finally:
        gc.unfreeze()
        gc.set_threshold(*thresholds)


def test_thresholds_come_back_after_an_error() -> None:
    thresholds = gc.get_threshold()
    with pytest.raises(ValueError, match="on the way"), no_full_collections():
        raise ValueError("on the way")
    assert gc.get_threshold() == thresholds

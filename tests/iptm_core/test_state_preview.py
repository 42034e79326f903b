"""A preview with bounds: what of it is known, and where the leader is at least."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from iptm_core.state import KNOWN_BOUND_M, LeaderPreview

TIMES = np.arange(5.0)
KNOWN = LeaderPreview(0.0, TIMES, 20.0 + 10.0 * TIMES, np.full(5, 10.0))


def test_without_bounds_all_is_known() -> None:
    assert (KNOWN.known_nodes, KNOWN.known_until_s) == (5, 4.0)
    assert KNOWN.cautious() is KNOWN


@pytest.mark.parametrize(
    ("bounds", "nodes", "until_s"),
    [
        ([0.0, 0.5, KNOWN_BOUND_M, 1.6, 9.0], 3, 2.0),
        ([0.0, 0.1, 0.2, 0.3, 0.4], 5, 4.0),
        ([0.0, 2.0, 1.0, 1.0, 1.0], 1, 0.0),
        ([2.0, 2.0, 2.0, 2.0, 2.0], 0, -math.inf),
    ],
)
def test_known_is_what_comes_before_the_first_large_bound(
    bounds: list[float], nodes: int, until_s: float
) -> None:
    preview = replace(KNOWN, bounds_m=np.array(bounds))
    assert (preview.known_nodes, preview.known_until_s) == (nodes, until_s)


def test_nothing_of_an_empty_preview_is_known() -> None:
    empty = LeaderPreview.empty()
    assert (empty.known_nodes, empty.known_until_s) == (0, -math.inf)


def test_cautious_motion_by_hand() -> None:
    preview = replace(KNOWN, bounds_m=np.array([1.0, 2.0, 5.0, 10.0, 41.0]))
    cautious = preview.cautious()
    # 59, 60 m less 10, 41 m: the leader does not drive backwards from where it was.
    assert cautious.positions_m.tolist() == [19.0, 28.0, 35.0, 40.0, 40.0]
    # Twice the mean rates of 1, 2, 3 and 10 m/s since the first node.
    assert cautious.speeds_m_s.tolist() == [10.0, 8.0, 6.0, 4.0, 0.0]
    assert cautious.bounds_m.size == 0

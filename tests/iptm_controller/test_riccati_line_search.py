"""Which points the filter of the line search accepts, by hand-made points."""

from __future__ import annotations

import math

import pytest

from iptm_controller.solvers.riccati.line_search import FilterPoint, LineSearchFilter

MU = 1e-3
UPHILL = 1.0


def point(cost: float, violation: float, log_sum: float = 0.0) -> FilterPoint:
    return FilterPoint(cost, log_sum, violation, violation)


def accepts(
    search: LineSearchFilter, trial: FilterPoint, current: FilterPoint, slope: float = UPHILL
) -> bool:
    return search.accepts(trial, current, MU, slope, 1.0)


@pytest.mark.parametrize(
    ("cost", "violation", "accepted"),
    [
        (10.0, 0.5, True),  # less violation, same cost
        (20.0, 0.5, True),  # less violation, more cost
        (9.0, 2.0, True),  # more violation, less cost
        (10.0, 1.0, False),  # nothing gained
        (11.0, 1.5, False),  # worse in both
        (10.0 - 1e-6, 1.0, False),  # less than the margin
        (9.0, 1e5, False),  # violation beyond all bounds
        (math.nan, 2.0, False),
        (9.0, math.nan, False),
        (-math.inf, math.inf, False),
    ],
)
def test_either_of_the_two_has_to_improve(cost: float, violation: float, accepted: bool) -> None:
    current = point(10.0, 1.0)
    assert accepts(LineSearchFilter(current), point(cost, violation), current) is accepted


def test_logarithms_count_with_the_barrier() -> None:
    current = point(10.0, 1.0, log_sum=0.0)
    # 0.01 more of cost, but 20 more of logarithms at a barrier of 1e-3: 0.01 less in all.
    assert accepts(LineSearchFilter(current), point(10.01, 1.0, log_sum=20.0), current)
    assert not accepts(LineSearchFilter(current), point(10.01, 1.0, log_sum=5.0), current)


def test_the_search_does_not_go_round_in_circles() -> None:
    """A point left for another one is not taken again, nor one that it dominates."""
    first, second = point(10.0, 1.0), point(12.0, 0.1)
    search = LineSearchFilter(first)
    assert accepts(search, second, first)
    assert not accepts(search, first, second)
    assert not accepts(search, point(10.5, 1.5), second)
    assert accepts(search, point(9.0, 0.9), second)


def test_near_feasibility_the_cost_has_to_descend() -> None:
    """With a small violation and a steep slope a smaller violation does not justify more cost."""
    current = point(10.0, 1e-6)
    search = LineSearchFilter(current)
    assert not accepts(search, point(10.1, 1e-9), current, slope=-1.0)
    assert accepts(search, point(9.9, 2e-6), current, slope=-1.0)
    # A decrease has to be a sufficient part of what the slope promises.
    assert not accepts(search, point(10.0 - 1e-6, 1e-6), current, slope=-1.0)


def test_a_descent_step_makes_no_entry() -> None:
    current, lower = point(10.0, 1e-6), point(9.0, 1e-6)
    search = LineSearchFilter(current)
    assert accepts(search, lower, current, slope=-1.0)
    # Had the start become an entry, this would be dominated by it.
    assert accepts(search, point(10.5, 5e-7), lower, slope=UPHILL)
    other = LineSearchFilter(current)
    assert accepts(other, lower, current, slope=UPHILL)
    assert not accepts(other, point(10.5, 2e-6), lower, slope=UPHILL)

"""What the line search accepts, by hand-made points."""

from __future__ import annotations

import math

import pytest

from iptm_controller.solvers.riccati.search_filter import SearchFilter, Values

MU = 1e-3
UPHILL = 1.0


def point(cost: float, residual: float, logarithms: float = 0.0) -> Values:
    return Values(cost, logarithms, residual, residual)


def accepts(search: SearchFilter, trial: Values, current: Values, slope: float = UPHILL) -> bool:
    return search.accepts(trial, current, MU, slope, 1.0)


def test_barrier_objective() -> None:
    assert point(5.0, 0.0, logarithms=-2.0).barrier_objective(0.1) == pytest.approx(5.2)


@pytest.mark.parametrize(
    ("cost", "residual", "accepted"),
    [
        (10.0, 0.5, True),  # less residual, same cost
        (20.0, 0.5, True),  # less residual, more cost
        (9.0, 2.0, True),  # more residual, less cost
        (10.0, 1.0, False),  # nothing gained
        (11.0, 1.5, False),  # worse in both
        (10.0 - 1e-6, 1.0, False),  # less than the margin
        (9.0, 1e5, False),  # residual beyond all bounds
        (math.nan, 2.0, False),
        (9.0, math.nan, False),
        (-math.inf, math.inf, False),
    ],
)
def test_either_of_the_two_has_to_improve(cost: float, residual: float, accepted: bool) -> None:
    current = point(10.0, 1.0)
    assert accepts(SearchFilter(current), point(cost, residual), current) is accepted


def test_logarithms_count_with_the_barrier() -> None:
    current = point(10.0, 1.0, logarithms=0.0)
    # 0.01 more of cost, but 20 more of logarithms at a barrier of 1e-3: 0.01 less in all.
    assert accepts(SearchFilter(current), point(10.01, 1.0, logarithms=20.0), current)
    assert not accepts(SearchFilter(current), point(10.01, 1.0, logarithms=5.0), current)


def test_the_search_does_not_go_round_in_circles() -> None:
    """A point left for another one is not taken again, nor one that it dominates."""
    first, second = point(10.0, 1.0), point(12.0, 0.1)
    search = SearchFilter(first)
    assert accepts(search, second, first)
    assert not accepts(search, first, second)
    assert not accepts(search, point(10.5, 1.5), second)
    assert accepts(search, point(9.0, 0.9), second)


def test_near_feasibility_the_cost_has_to_descend() -> None:
    """With a small residual and a steep slope a smaller residual is no excuse for more cost."""
    current = point(10.0, 1e-6)
    search = SearchFilter(current)
    assert not accepts(search, point(10.1, 1e-9), current, slope=-1.0)
    assert accepts(search, point(9.9, 2e-6), current, slope=-1.0)
    # A decrease has to be a sufficient part of what the slope promises.
    assert not accepts(search, point(10.0 - 1e-6, 1e-6), current, slope=-1.0)


def test_a_descent_step_makes_no_entry() -> None:
    current, lower = point(10.0, 1e-6), point(9.0, 1e-6)
    search = SearchFilter(current)
    assert accepts(search, lower, current, slope=-1.0)
    # Had the start become an entry, this would be dominated by it.
    assert accepts(search, point(10.5, 5e-7), lower, slope=UPHILL)
    other = SearchFilter(current)
    assert accepts(other, lower, current, slope=UPHILL)
    assert not accepts(other, point(10.5, 2e-6), lower, slope=UPHILL)

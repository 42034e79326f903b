"""The search for deeper valleys: what is drawn, where it starts, and what counts as dearer."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.valleys import best_of, draw, running_cost, starts
from tests.iptm_controller.scenes import PARAMETERS, plain_solver

from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import GlobalIndex

GRID = ProblemGrid(MULTI_HORIZON)


def test_starts_are_all_different_and_reproducible() -> None:
    found = starts(np.random.default_rng(3), GRID.steps, 4)
    assert len(found) == 5 + 2 * (GRID.steps - 1) + 4
    assert len({tuple(powers) for powers in found[:-4]}) == len(found) - 4
    again = starts(np.random.default_rng(3), GRID.steps, 4)
    np.testing.assert_array_equal(found, again)


@pytest.mark.parametrize("seed", range(4))
def test_the_best_start_is_never_dearer_than_the_plan(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data, guess = draw(rng, PARAMETERS, GRID)
    assert (
        data.parameters[GlobalIndex.CELL_N_PRICE] > data.parameters[GlobalIndex.CELL_1_PRICE] > 0.0
    )
    plan = plain_solver(str(MULTI_HORIZON)).solve(data, guess)
    assert plan.status.usable
    best = best_of(plain_solver(str(MULTI_HORIZON)), GRID, data, plan, starts(rng, GRID.steps, 1))
    assert best <= plan.objective
    # What a plan costs does not depend on where the zero of the price lies: aging is positive.
    assert running_cost(GRID, data, plan) > 0.1

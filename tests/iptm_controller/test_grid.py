"""The flat vectors of a problem: packed and cut without loss, every step in its place."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid, quadrature, sample_count

GRIDS = ["15x1", "3x1+5x5", "1x0.5+2x2+4x10", "1x1"]


@pytest.fixture(params=GRIDS)
def grid(request: pytest.FixtureRequest) -> ProblemGrid:
    return ProblemGrid(Horizon.parse(request.param))


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_quadrature_is_exact_up_to_its_degree(samples: int) -> None:
    nodes, weights = quadrature(samples)
    assert weights.sum() == pytest.approx(1.0)
    assert ((nodes > 0.0) & (nodes < 1.0)).all()
    for degree in range(2 * samples):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1))
    too_high = 2 * samples
    assert weights @ nodes**too_high != pytest.approx(1.0 / (too_high + 1), abs=1e-9)


def test_variables_are_packed_step_by_step(grid: ProblemGrid) -> None:
    flat = np.arange(float(grid.variable_count))
    states, inputs = grid.split(flat)
    assert states.shape == (grid.steps + 1, layout.STATES)
    for step in range(grid.steps):
        start = step * (layout.STATES + layout.INPUTS)
        np.testing.assert_array_equal(states[step], start + np.arange(layout.STATES))
        np.testing.assert_array_equal(inputs[step], start + 6 + np.arange(layout.INPUTS))
    np.testing.assert_array_equal(states[-1], flat[-layout.STATES :])
    np.testing.assert_array_equal(grid.join(states, inputs), flat)
    states[:], inputs[:] = 0.0, 0.0
    assert flat[1] == 1.0


def test_parameters_are_packed_step_by_step(grid: ProblemGrid) -> None:
    """Every slot is filled once: globals, then each step's own and its samples."""
    rng = np.random.default_rng(1)
    shared = rng.normal(size=layout.GLOBALS)
    steps = rng.normal(size=(grid.steps, layout.STEP_PARAMETERS))
    samples = rng.normal(size=(grid.sample_times_s.size, layout.SAMPLE_PARAMETERS))
    expected, sample = [shared], 0
    for step, length in zip(steps, grid.horizon.step_lengths_s, strict=True):
        count = sample_count(float(length))
        expected += [step, samples[sample : sample + count].ravel()]
        sample += count
    vector = grid.parameters(shared, steps, samples)
    np.testing.assert_array_equal(vector, np.concatenate(expected))


def test_samples_lie_at_the_quadrature_nodes_of_their_steps(grid: ProblemGrid) -> None:
    horizon = grid.horizon
    expected = [
        start + node * length
        for start, length in zip(horizon.node_times_s[:-1], horizon.step_lengths_s, strict=True)
        for node in quadrature(sample_count(float(length)))[0]
    ]
    np.testing.assert_allclose(grid.sample_times_s, expected)

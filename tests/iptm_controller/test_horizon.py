"""Horizons as text and as numbers, and the flat vectors of a problem on them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_controller.horizon import MAX_NODES, MULTI_HORIZON, SINGLE_HORIZON, Horizon, HorizonPhase
from iptm_controller.ocp.grid import quadrature
from iptm_core.errors import ParameterError

STEPS = st.integers(1, 60)
TWENTIETHS = st.integers(1, 1200).map(lambda count: count / 20.0)
HORIZONS = st.lists(st.tuples(STEPS, TWENTIETHS), min_size=1, max_size=5).map(
    lambda pairs: Horizon(tuple(HorizonPhase(*pair) for pair in sorted(pairs, key=lambda p: p[1])))
)


def test_horizons_of_the_paper() -> None:
    assert Horizon.parse("15x1") == SINGLE_HORIZON
    assert Horizon.parse("3x1+5x5") == MULTI_HORIZON
    assert MULTI_HORIZON.steps == 8
    assert MULTI_HORIZON.duration_s == 28.0
    assert MULTI_HORIZON.step_lengths_s.tolist() == [1, 1, 1, 5, 5, 5, 5, 5]
    assert MULTI_HORIZON.node_times_s.tolist() == [0, 1, 2, 3, 8, 13, 18, 23, 28]


@pytest.mark.parametrize("text", ["3x1+5x5", " 3 x 1 + 5x5 ", "3*1s + 5 * 5.0 s", "3x1.0+5x5"])
def test_spelling_does_not_matter(text: str) -> None:
    assert Horizon.parse(text) == MULTI_HORIZON


@given(horizon=HORIZONS)
def test_text_and_horizon_are_the_same_thing(horizon: Horizon) -> None:
    assert Horizon.parse(str(horizon)) == horizon


@given(horizon=HORIZONS)
def test_grid_is_consistent(horizon: Horizon) -> None:
    lengths, nodes = horizon.step_lengths_s, horizon.node_times_s
    assert lengths.shape == (horizon.steps,)
    assert nodes.shape == (horizon.steps + 1,)
    assert nodes[0] == 0.0
    assert horizon.duration_s == nodes[-1]
    np.testing.assert_allclose(np.diff(nodes), lengths, rtol=0.0, atol=1e-9)
    assert (np.diff(lengths) >= 0.0).all()
    assert sum(phase.steps * phase.step_s for phase in horizon.phases) == pytest.approx(nodes[-1])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "cannot be read at ''"),
        ("15", "cannot be read at '15'"),
        ("x1", "cannot be read"),
        ("3x", "cannot be read"),
        ("3x1+", "cannot be read at ''"),
        ("3x1,5x5", "cannot be read"),
        ("3x-1", "cannot be read"),
        ("-3x1", "cannot be read"),
        ("3xnan", "cannot be read"),
        ("1.5x2", "cannot be read"),
        ("0x1", "0 steps"),
        (f"{MAX_NODES + 1}x1", "20001 steps"),
        ("3x0", "step of 0.0 s"),
        ("3x0.04", "step of 0.04 s"),
        ("3x61", "step of 61.0 s"),
        ("5x5+3x1", "do not shrink"),
        ("10x30t", "allowed: thermal phases last"),
        ("3x1t+5x5", "allowed: thermal phases last"),
    ],
)
def test_refusals_name_the_fault(text: str, complaint: str) -> None:
    with pytest.raises(ParameterError) as caught:
        Horizon.parse(text)
    assert complaint in str(caught.value)


@given(text=st.text("0123456789x*+. s-en\t", max_size=20) | st.text(max_size=10))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        horizon = Horizon.parse(text)
    except ParameterError:
        return
    assert horizon.steps >= 1
    assert np.isfinite(horizon.duration_s)


@pytest.mark.parametrize("step_s", [float("nan"), float("inf"), -1.0])
def test_a_horizon_needs_phases_of_some_length(step_s: float) -> None:
    with pytest.raises(ParameterError, match="step of"):
        HorizonPhase(3, step_s)
    with pytest.raises(ParameterError, match="at least one"):
        Horizon(())


def test_thermal_phases_are_written_with_a_t() -> None:
    horizon = Horizon.parse("3x1 + 5x5+10x30t")
    assert str(horizon) == "3x1+5x5+10x30t"
    assert [phase.thermal for phase in horizon.phases] == [False, False, True]
    assert (horizon.steps, horizon.motion_steps) == (18, 8)
    assert (horizon.duration_s, horizon.motion_duration_s) == (328.0, 28.0)
    assert Horizon.parse("15x1").motion_duration_s == 15.0


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_quadrature_is_exact_up_to_its_degree(samples: int) -> None:
    nodes, weights = quadrature(samples)
    assert weights.sum() == pytest.approx(1.0)
    assert ((nodes > 0.0) & (nodes < 1.0)).all()
    for degree in range(2 * samples):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1))
    too_high = 2 * samples
    assert weights @ nodes**too_high != pytest.approx(1.0 / (too_high + 1), abs=1e-9)

"""Capacity loss: the incremental equation against the closed form it was derived from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s

Agree = Callable[..., None]
VALUES = load_parameters().values
AGING, CELL = VALUES.aging, VALUES.cell
GAS = 8.314462618
TEMPERATURES = st.floats(298.15, 313.15)
CURRENTS = st.floats(0.01, 15.0)


def rate(current: float, temperature: float, loss: float, width: float = 0.0) -> float:
    value: float = capacity_loss_rate_1_s(
        current, temperature, loss, AGING, CELL, current_smoothing_a=width
    )
    return value


def closed_form_loss(throughput_ah: float, temperature: float, c_rate: float) -> float:
    """Eq. (11) with the printed numbers."""
    exponent = (-15162.0 + 1516.0 * c_rate) / (GAS * temperature)
    return float(0.0032 * math.exp(exponent) * throughput_ah**0.824)


def throughput_ah(loss: float, temperature: float, c_rate: float) -> float:
    """The throughput at which eq. (11) reaches a loss."""
    return float((loss / closed_form_loss(1.0, temperature, c_rate)) ** (1.0 / 0.824))


def test_the_rate_by_hand() -> None:
    """Eq. (12) with 5.019 A (1C), 300 K and the initial loss of 0.001, factor by factor."""
    z = 0.824
    expected = (
        (5.019 / 3600.0)
        * z
        * 0.0032 ** (1.0 / z)
        * math.exp((-15162.0 + 1516.0) / (z * GAS * 300.0))
        * 0.001 ** (1.0 - 1.0 / z)
    )
    assert rate(5.019, 300.0, 0.001) == pytest.approx(expected, rel=1e-12)
    assert rate(-5.019, 300.0, 0.001) == rate(5.019, 300.0, 0.001)
    assert rate(0.0, 300.0, 0.001) == 0.0


@given(current=CURRENTS, temperature=TEMPERATURES, loss=st.floats(1e-4, 0.2))
def test_the_rate_is_the_slope_of_the_closed_form(
    current: float, temperature: float, loss: float
) -> None:
    """d Q / d A_h = z Q / A_h at the throughput that led to this loss."""
    c_rate = current / 5.019
    throughput = throughput_ah(loss, temperature, c_rate)
    slope_1_ah = 0.824 * loss / throughput
    assert rate(current, temperature, loss) == pytest.approx(
        slope_1_ah * current / 3600.0, rel=1e-10
    )


@pytest.mark.parametrize(
    ("current", "temperature", "hours"), [(5.019, 303.15, 50.0), (-2.0, 313.15, 200.0)]
)
def test_the_increments_add_up_to_the_closed_form(
    current: float, temperature: float, hours: float
) -> None:
    """Constant current and temperature, from the initial loss on, by fourth-order steps."""
    c_rate, steps = abs(current) / 5.019, 400
    start_ah = throughput_ah(0.001, temperature, c_rate)
    moved_ah = abs(current) * hours
    expected = closed_form_loss(start_ah + moved_ah, temperature, c_rate)
    loss, step_s = 0.001, 3600.0 * hours / steps
    for _ in range(steps):
        k_1 = rate(current, temperature, loss)
        k_2 = rate(current, temperature, loss + 0.5 * step_s * k_1)
        k_3 = rate(current, temperature, loss + 0.5 * step_s * k_2)
        k_4 = rate(current, temperature, loss + step_s * k_3)
        loss += step_s * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4) / 6.0
    assert loss - 0.001 == pytest.approx(expected - 0.001, rel=1e-8)
    assert loss > 1.1 * 0.001  # the loss itself has moved, so its own exponent was exercised


@given(current=CURRENTS, temperature=TEMPERATURES)
def test_one_second_needs_no_finer_step(current: float, temperature: float) -> None:
    """One explicit step of 1 s is the closed form to 1e-5 of the increment."""
    c_rate = current / 5.019
    start_ah = throughput_ah(0.001, temperature, c_rate)
    # d ln(rate) / dt is (z - 1) / A_h * |I| / 3600: half of it is the error of one explicit step
    error = 0.5 * 0.176 * current / 3600.0 / start_ah
    exact_increment = 0.001 * math.expm1(0.824 * math.log1p(current / 3600.0 / start_ah))
    assert rate(current, temperature, 0.001) == pytest.approx(
        exact_increment, rel=1.1 * error + 1e-10
    )
    assert error < 1e-5


@given(current=st.floats(-15.0, 15.0), temperature=TEMPERATURES, loss=st.floats(1e-4, 0.3))
def test_ageing_never_reverses_and_slows_with_age(
    current: float, temperature: float, loss: float
) -> None:
    here = rate(current, temperature, loss)
    assert here >= 0.0
    assert rate(current, temperature, 1.01 * loss) <= here
    assert rate(current, temperature + 1.0, loss) >= here


def test_sensitivities_of_the_printed_constants() -> None:
    """About 2.4 % per kelvin, and exp(0.7 C-rate) on top of the linear current."""
    here = rate(1e-9, 303.15, 0.001)
    assert rate(1e-9, 304.15, 0.001) / here - 1.0 == pytest.approx(0.024, abs=5e-4)
    one_c, two_c = rate(5.019, 303.15, 0.001), rate(10.038, 303.15, 0.001)
    assert math.log(two_c / one_c / 2.0) == pytest.approx(1516.0 / (0.824 * GAS * 303.15), rel=1e-9)
    assert math.log(two_c / one_c / 2.0) == pytest.approx(0.73, abs=0.01)


def test_a_linear_law_forgets_its_age() -> None:
    linear = replace(AGING, throughput_exponent=1.0)
    rates = {capacity_loss_rate_1_s(3.0, 300.0, loss, linear, CELL) for loss in (0.001, 0.01, 0.1)}
    assert len(rates) == 1


@given(current=st.floats(-15.0, 15.0), temperature=TEMPERATURES, width=st.floats(0.001, 0.1))
def test_the_smoothed_rate_errs_by_a_known_amount(
    current: float, temperature: float, width: float
) -> None:
    """The magnitude is at most the width too high, so the rate is at most this current's slope off.

    With w = width: rate(|I| + e) - rate(|I|) for 0 <= e <= min(w, w^2 / (2 |I|)).
    """
    excess = width if current == 0.0 else min(width, width**2 / (2.0 * abs(current)))
    exact = rate(current, temperature, 0.001)
    error = rate(current, temperature, 0.001, width) - exact
    bound = rate(abs(current) + excess, temperature, 0.001) - exact
    assert -1e-12 * exact <= error <= bound + 1e-12 * (exact + bound)


def test_the_error_of_the_width_in_use_is_small_where_it_counts() -> None:
    """0.05 A: above 0.5 A of cell current (0.1C) the smoothed rate is within 0.6 %, above 2 A 0.05 %."""
    for temperature in (298.15, 313.15):
        for current, relative in ((0.5, 6e-3), (2.0, 5e-4), (10.0, 5e-5)):
            exact = rate(current, temperature, 0.001)
            assert 0.0 < rate(current, temperature, 0.001, 0.05) / exact - 1.0 < relative


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(10)
    current = np.append(random.uniform(-15.0, 15.0, 40), 0.0)
    temperature, loss = random.uniform(298.0, 313.0, 41), random.uniform(1e-3, 0.2, 41)
    for width in (0.0, 0.05):
        agree_in_all_backends(
            lambda i, t, q, width=width: capacity_loss_rate_1_s(
                i, t, q, parameters.aging, parameters.cell, current_smoothing_a=width
            ),
            current,
            temperature,
            loss,
        )

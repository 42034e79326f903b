"""Power at the battery terminals: efficiencies and partial regeneration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.electrical import battery_power_w

Agree = Callable[..., None]
VALUES = load_parameters().values
LOSSY_PACK = replace(VALUES.pack, battery_efficiency=0.95)
TRACTION = st.floats(-60e3, 90e3)
COMPRESSOR = st.floats(0.0, 4500.0)


def by_the_printed_cases(traction: float, compressor: float, efficiency: float) -> float:
    if traction >= 0.0:
        return (traction + compressor + 200.0) / efficiency
    return efficiency * 0.3 * traction + (compressor + 200.0) / efficiency


def test_by_hand() -> None:
    def at_terminals(traction: float, efficiency: float) -> float:
        pack = replace(VALUES.pack, battery_efficiency=efficiency)
        return float(battery_power_w(traction, 800.0, 200.0, pack, VALUES.powertrain))

    assert at_terminals(9000.0, 1.0) == 10000.0
    assert at_terminals(-9000.0, 1.0) == pytest.approx(-1700.0, rel=1e-12)
    assert at_terminals(8500.0, 0.95) == pytest.approx(10000.0, rel=1e-12)
    # 0.95 * 0.3 * -10000 + 1000 / 0.95 = -2850 + 1052.63
    assert at_terminals(-10000.0, 0.95) == pytest.approx(-1797.368421, rel=1e-9)
    assert at_terminals(0.0, 1.0) == 1000.0


@pytest.mark.parametrize("efficiency", [1.0, 0.95, 0.5])
@given(traction=TRACTION, compressor=COMPRESSOR)
def test_one_convex_kink_is_the_two_printed_cases(
    efficiency: float, traction: float, compressor: float
) -> None:
    pack = replace(VALUES.pack, battery_efficiency=efficiency)
    power = battery_power_w(traction, compressor, 200.0, pack, VALUES.powertrain)
    assert power == pytest.approx(
        by_the_printed_cases(traction, compressor, efficiency), rel=1e-13, abs=1e-9
    )


def test_full_regeneration_by_a_lossless_battery_has_no_kink() -> None:
    powertrain = replace(VALUES.powertrain, regenerative_efficiency=1.0)
    for traction in (-5000.0, 0.0, 5000.0):
        for width in (0.0, 500.0):
            power = battery_power_w(
                traction, 0.0, 200.0, VALUES.pack, powertrain, power_smoothing_w=width
            )
            assert power == traction + 200.0


@given(traction=TRACTION, width=st.floats(1.0, 1000.0))
def test_the_smoothed_power_errs_by_a_known_amount(traction: float, width: float) -> None:
    """Above the exact power by at most (1/eta_b - eta_b zeta) width / 2, less away from zero."""
    spread = 1.0 / 0.95 - 0.95 * 0.3
    arguments = (traction, 500.0, 200.0, LOSSY_PACK, VALUES.powertrain)
    error = battery_power_w(*arguments, power_smoothing_w=width) - battery_power_w(*arguments)
    bound = 0.5 * spread * width
    if abs(traction) > width:
        bound = 0.25 * spread * width**2 / abs(traction)
    assert -1e-9 <= error <= bound + 1e-9


def test_the_smoothed_power_error_at_the_kink_is_its_bound() -> None:
    # 0.5 * (1 - 0.3) * 500 W
    power = battery_power_w(0.0, 0.0, 0.0, VALUES.pack, VALUES.powertrain, power_smoothing_w=500.0)
    assert power == pytest.approx(175.0, rel=1e-12)


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(3)
    traction = np.append(random.uniform(-60e3, 90e3, 40), 0.0)
    compressor = random.uniform(0.0, 4500.0, 41)
    for width in (0.0, 500.0):
        agree_in_all_backends(
            lambda tra, cp, width=width: battery_power_w(
                tra, cp, 200.0, parameters.pack, parameters.powertrain, power_smoothing_w=width
            ),
            traction,
            compressor,
        )

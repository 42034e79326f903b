"""The coolant loop solved at once is what going around it again and again converges to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.chiller import ChillerLine, chiller_line
from iptm_core.physics.coolant import (
    ChannelWeights,
    exchange_ratio,
    reduce_channel,
)
from iptm_core.physics.thermal_loop import CoolantLoop, solve_coolant_loop

Agree = Callable[..., None]
SETS = {name: load_parameters(name).values for name in ("paper_calibrated", "published_chiller")}
FLOW_W_K = 0.144 * 3330.0
TEMPERATURES = st.floats(293.15, 318.15)


def coolant_profile_k(inlet_k: float, cells_k: np.ndarray, ratio: float) -> np.ndarray:
    """Eq. (9) cell by cell: what each cell meets, and the outlet, shape (n + 1,)."""
    profile = [inlet_k]
    for cell_k in cells_k.tolist():
        profile.append(profile[-1] + ratio * (cell_k - profile[-1]))
    return np.array(profile)


def solve(
    values: ModelParameters, cell_1: float, cell_n: float, power: float, speed: float
) -> CoolantLoop:
    line = chiller_line(power, speed, values.chiller, values.cooling, values.environment)
    outlet = reduce_channel(values.cooling, values.pack).outlet
    return solve_coolant_loop(cell_1, cell_n, line, outlet, values.cooling)


@pytest.mark.parametrize("name", SETS)
@given(
    cell_1=TEMPERATURES,
    cell_n=TEMPERATURES,
    power=st.floats(0.0, 4500.0),
    speed=st.floats(0.0, 37.5),
)
def test_the_closed_form_is_the_fixed_point(
    name: str, cell_1: float, cell_n: float, power: float, speed: float
) -> None:
    """Start anywhere, go around chiller and all 228 cells until nothing moves."""
    values = SETS[name]
    line = chiller_line(power, speed, values.chiller, values.cooling, values.environment)
    ratio = exchange_ratio(values.cooling, values.pack)
    cells = np.linspace(cell_1, cell_n, 228)
    outlet = 300.0
    for _ in range(30):
        inlet = outlet - line.cooling_rate_w(outlet) / FLOW_W_K
        outlet = float(coolant_profile_k(inlet, cells, ratio)[-1])
    loop = solve(values, cell_1, cell_n, power, speed)
    assert loop.outlet_k == pytest.approx(outlet, abs=1e-9)
    assert loop.inlet_k == pytest.approx(outlet - line.cooling_rate_w(outlet) / FLOW_W_K, abs=1e-9)


@pytest.mark.parametrize("name", SETS)
@given(
    cell_1=TEMPERATURES,
    cell_n=TEMPERATURES,
    power=st.floats(0.0, 4500.0),
    speed=st.floats(0.0, 37.5),
)
def test_the_chiller_takes_what_the_cells_give(
    name: str, cell_1: float, cell_n: float, power: float, speed: float
) -> None:
    """Q_co = m_c C_p (T_out - T_in) = N_m sum h (T_bc,i - T_c,i): nothing is lost on the way."""
    values = SETS[name]
    loop = solve(values, cell_1, cell_n, power, speed)
    line = chiller_line(power, speed, values.chiller, values.cooling, values.environment)
    assert loop.cooling_rate_w == pytest.approx(line.cooling_rate_w(loop.outlet_k), abs=1e-7)
    assert loop.cooling_rate_w == pytest.approx(FLOW_W_K * (loop.outlet_k - loop.inlet_k), abs=1e-7)
    cells = np.linspace(cell_1, cell_n, 228)
    profile = coolant_profile_k(loop.inlet_k, cells, exchange_ratio(values.cooling, values.pack))
    given_off = 16 * 0.4901 * float(np.sum(cells - profile[:-1]))
    assert loop.cooling_rate_w == pytest.approx(given_off, abs=1e-6)


@pytest.mark.parametrize("name", SETS)
@given(cell_1=TEMPERATURES, cell_n=TEMPERATURES, speed=st.floats(0.0, 37.5))
def test_without_compressor_the_coolant_settles_between_the_cells(
    name: str, cell_1: float, cell_n: float, speed: float
) -> None:
    loop = solve(SETS[name], cell_1, cell_n, 0.0, speed)
    assert loop.cooling_rate_w == 0.0
    assert loop.inlet_k == loop.outlet_k
    assert min(cell_1, cell_n) - 1e-9 <= loop.outlet_k <= max(cell_1, cell_n) + 1e-9


def test_by_hand_with_round_numbers() -> None:
    """w = (0.2, 0.3, 0.5), cells at 30 and 40 degC, chiller of 47.952 W/K: a tenth of the flow.

    T_out = 0.2 T_in + 9 + 20 and T_in = 0.9 T_out give T_out = 29 / 0.82 degC.
    """
    cooling = SETS["paper_calibrated"].cooling
    loop = solve_coolant_loop(
        303.15, 313.15, ChillerLine(0.0, 47.952, 1.0), ChannelWeights(0.2, 0.3, 0.5), cooling
    )
    outlet_c = 29.0 / 0.82
    assert loop.outlet_k == pytest.approx(273.15 + outlet_c, rel=1e-13)
    assert loop.inlet_k == pytest.approx(273.15 + 0.9 * outlet_c, rel=1e-13)
    assert loop.cooling_rate_w == pytest.approx(47.952 * outlet_c, rel=1e-12)


def test_a_chiller_of_fixed_rate_lowers_the_inlet_by_rate_over_flow() -> None:
    cooling = SETS["paper_calibrated"].cooling
    loop = solve_coolant_loop(
        300.0, 300.0, ChillerLine(959.04, 0.0, 1.0), ChannelWeights(0.2, 0.3, 0.5), cooling
    )
    # 959.04 W / 479.52 W/K = 2 K; T_out = 0.2 (T_out - 2) + 0.8 * 300
    assert loop.outlet_k - loop.inlet_k == pytest.approx(2.0, rel=1e-12)
    assert loop.outlet_k == pytest.approx(299.5, rel=1e-13)


def test_all_backends_agree(agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(9)
    columns = [
        random.uniform(293.0, 318.0, 40),
        random.uniform(293.0, 318.0, 40),
        random.uniform(0.0, 4500.0, 40),
        random.uniform(0.0, 37.5, 40),
    ]
    for values in SETS.values():
        for name in ("inlet_k", "outlet_k", "cooling_rate_w"):
            agree_in_all_backends(
                lambda t_1, t_n, power, speed, values=values, name=name: getattr(
                    solve(values, t_1, t_n, power, speed), name
                ),
                *columns,
                rtol=1e-11,
            )

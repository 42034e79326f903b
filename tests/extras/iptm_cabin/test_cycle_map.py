"""The map of the refrigerant cycle: against CoolProp (1,000 points) where installed, and against physics."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from iptm_cabin.cycle_fit import efficiencies, samples
from iptm_cabin.cycle_map import BOUNDS, Refrigerant, cycle_map

RMS, WORST = 0.02, 0.05


@pytest.mark.skipif(
    find_spec("CoolProp") is None, reason="CoolProp is not installed (requirements/cabin.txt)"
)
@pytest.mark.parametrize("fluid", Refrigerant)
def test_the_map_holds_at_points_that_were_not_fitted(fluid: Refrigerant) -> None:
    points, true = samples(fluid, 250, 7)
    fitted = cycle_map(fluid)
    found = np.c_[fitted.performance(*points.T), fitted.capacity_j_m3(*points.T)]
    error = found / true - 1.0
    assert np.sqrt((error**2).mean(axis=0)).max() <= RMS
    assert np.abs(error).max() <= WORST


@pytest.mark.parametrize("fluid", Refrigerant)
def test_recorded_errors_are_within_the_bars(fluid: Refrigerant) -> None:
    fitted = cycle_map(fluid)
    assert max(fitted.rms) <= RMS
    assert max(fitted.worst) <= WORST


@pytest.mark.parametrize("fluid", Refrigerant)
def test_more_lift_costs_more_and_colder_vapour_carries_less(fluid: Refrigerant) -> None:
    fitted, bounds = cycle_map(fluid), BOUNDS[fluid]
    cold = np.linspace(-25.0, 10.0, 15)
    hot = np.linspace(bounds[1][0] + 15.0, bounds[1][1], 15)
    cop = fitted.performance(cold[:, None], hot[None, :], 80.0)
    capacity = fitted.capacity_j_m3(cold[:, None], hot[None, :], 80.0)
    carnot = (cold[:, None] + 273.15) / (hot[None, :] - cold[:, None])
    assert (np.diff(cop, axis=0) > 0.0).all()
    assert (np.diff(cop, axis=1) < 0.0).all()
    assert (np.diff(capacity, axis=0) > 0.0).all()
    assert (cop < carnot).all()


def test_outside_of_the_map_its_edge_counts() -> None:
    fitted = cycle_map(Refrigerant.R1234YF)
    evaporation, condensation, speed = fitted.within(-60.0, 90.0, 500.0)
    assert evaporation == pytest.approx(-30.0, abs=0.6)
    assert condensation == pytest.approx(70.0, abs=0.6)
    assert speed == pytest.approx(145.0, abs=1.1)


def test_the_compressor_is_near_a_measured_one() -> None:
    """A scroll compressor with R134a, 118 tests: Cuevas et al., Applied Thermal Engineering 30 (2010) 605."""
    ratios = np.linspace(1.5, 8.0, 66)
    isentropic = np.array([efficiencies(float(each), 60.0)[0] for each in ratios])
    assert isentropic.max() == pytest.approx(0.72, abs=0.01)
    assert ratios[isentropic.argmax()] == pytest.approx(2.55, abs=0.3)
    for ratio, volumetric in ((1.3, 1.0), (9.7, 0.83)):
        assert efficiencies(ratio, 60.0)[1] == pytest.approx(volumetric, rel=0.1)

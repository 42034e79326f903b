"""Generated hills, their grid, and slope profiles from other sources."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import SlopeProfile
from iptm_core.routes.slope import Hills

LENGTHS_M = st.floats(50.0, 60000.0)
VARIANTS = st.integers(0, 50)


def hilly(length_m: float, peak_grade: float, variant: int) -> SlopeProfile:
    return SlopeProfile.from_hills([Hills(0.0, length_m, peak_grade, variant)])


def heights_m(profile: SlopeProfile, positions_m: np.ndarray) -> np.ndarray:
    """Heights above the first position, by the trapezoidal rule on the sine of the slope."""
    sines = np.sin(profile.slope_at(positions_m))
    return np.append(0.0, np.cumsum(0.5 * (sines[1:] + sines[:-1]) * np.diff(positions_m)))


@given(LENGTHS_M, VARIANTS, st.sampled_from([0.0, 0.02, 0.06, 0.3]))
def test_hills_have_the_peak_zero_mean_and_vanish_at_the_ends(
    length_m: float, variant: int, peak: float
) -> None:
    hills = Hills(100.0, length_m, peak, variant)
    positions = np.linspace(100.0, 100.0 + length_m, 20001)
    slopes = hills.slope_at(positions)
    limit = np.arctan(peak)
    assert np.max(np.abs(slopes)) == pytest.approx(limit, rel=2e-3)
    # The mean is zero analytically; on equal steps the trapezoidal rule is exact for it too.
    assert abs(np.mean(slopes[:-1])) < 1e-15
    assert slopes[0] == slopes[-1] == 0.0
    end_gradient = np.abs(slopes[[1, -2]]) / (positions[1] - positions[0])
    assert np.all(end_gradient <= 0.01 * np.max(np.abs(np.gradient(slopes, positions))))


@given(LENGTHS_M, VARIANTS)
def test_grid_interpolation_is_within_1e_4_rad_of_the_formula(
    length_m: float, variant: int
) -> None:
    hills = Hills(0.0, length_m, 0.06, variant)
    profile = SlopeProfile.from_hills([hills])
    between = np.linspace(0.0, length_m, 30011)
    error = profile.slope_at(between) - hills.slope_at(between)
    assert np.max(np.abs(error)) < 1e-4


def test_hills_are_deterministic_and_variants_differ() -> None:
    first, again, other = (hilly(5000.0, 0.02, variant) for variant in (3, 3, 4))
    np.testing.assert_array_equal(first.slopes_rad, again.slopes_rad)
    assert np.max(np.abs(first.slopes_rad - other.slopes_rad)) > 0.005


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 49.0, 0.06), "at least 50 m"),
        ((np.nan, 100.0, 0.06), "finite"),
        ((0.0, np.inf, 0.06), "finite"),
        ((0.0, 100.0, 0.31), r"0\.31; allowed: 0 to 0\.3"),
        ((0.0, 100.0, -0.1), "allowed: 0 to"),
        ((0.0, 100.0, 0.1, -1), "integer >= 0"),
    ],
)
def test_malformed_hills_are_refused(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(RouteError, match=message):
        Hills(*arguments)  # type: ignore[arg-type]


def test_slope_is_zero_outside_the_hills() -> None:
    hills = Hills(100.0, 500.0, 0.06)
    np.testing.assert_array_equal(hills.slope_at([-1e6, 0.0, 99.9, 600.1, 1e6]), np.zeros(5))


def test_slope_is_interpolated_and_held_at_the_ends() -> None:
    profile = SlopeProfile(np.array([10.0, 20.0]), np.array([0.01, 0.03]))
    np.testing.assert_allclose(
        profile.slope_at([0.0, 10.0, 15.0, 20.0, 99.0]), [0.01, 0.01, 0.02, 0.03, 0.03]
    )
    assert profile.slope_at(15.0).shape == ()


@given(LENGTHS_M, VARIANTS)
def test_generated_hills_return_to_their_height(length_m: float, variant: int) -> None:
    profile = hilly(length_m, 0.06, variant)
    # sin(theta) differs from theta by less than theta^3 / 6 = 3.6e-5 at 6 %.
    assert abs(heights_m(profile, profile.positions_m)[-1]) < 4e-5 * length_m


def test_profile_from_elevations_returns_the_heights() -> None:
    positions = np.arange(0.0, 3001.0, 5.0)
    heights = 250.0 + 8.0 * np.sin(2.0 * np.pi * positions / 1500.0)
    profile = SlopeProfile.from_elevations(positions, heights)
    sines = 8.0 * 2.0 * np.pi / 1500.0 * np.cos(2.0 * np.pi * positions / 1500.0)
    inner = (positions > 20.0) & (positions < 2980.0)
    np.testing.assert_allclose(
        profile.slope_at(positions)[inner], np.arcsin(sines)[inner], atol=1e-4
    )
    climbs = heights_m(profile, positions)
    np.testing.assert_allclose(climbs, heights - heights[0], atol=0.05)


def test_noise_of_elevations_is_not_amplified_by_dense_points() -> None:
    positions = np.arange(0.0, 1000.0, 0.5)
    noise = 0.05 * np.where(np.arange(positions.size) % 2 == 0, 1.0, -1.0)
    profile = SlopeProfile.from_elevations(positions, noise)
    assert np.max(np.abs(profile.slopes_rad)) <= 0.1 / 19.0


@pytest.mark.parametrize(("positions", "heights"), [([3.0], [100.0]), ([0.0, 5.0], [7.0, 7.0])])
def test_short_elevation_profiles_are_level(positions: list[float], heights: list[float]) -> None:
    profile = SlopeProfile.from_elevations(positions, heights)
    np.testing.assert_array_equal(profile.slopes_rad, [0.0])


def test_too_steep_profiles_are_refused() -> None:
    with pytest.raises(RouteError, match=r"31\.0 % at 5\.0 m; allowed: -30 % to 30 %"):
        SlopeProfile(np.array([0.0, 5.0]), np.array([0.0, np.arctan(0.31)]))
    SlopeProfile(np.array([0.0]), np.array([np.arctan(0.3)]))
    with pytest.raises(RouteError, match="allowed: -30 % to 30 %"):
        SlopeProfile.from_elevations([0.0, 100.0], [0.0, 500.0])

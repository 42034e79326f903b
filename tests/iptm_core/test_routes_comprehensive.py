"""Compositions of the comprehensive cycle: order, duration, grades and climb, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.routes import ROUTE_CYCLES, build_route, comprehensive_cycle, load_cycle
from iptm_core.routes.comprehensive import (
    RouteComposition,
    composition_names,
    load_composition,
    read_composition,
)

SHIPPED = [load_composition(name) for name in composition_names()]
STEEP = RouteComposition(
    "steep",
    ("nycc", "wltc_class3b", "us06", "sc03", "smooth"),
    large_grade=0.16,
    small_grade=0.05,
    mean_climb=0.02,
    hill_length_m=1500.0,
    smooth_low_km_h=80.0,
    smooth_high_km_h=110.0,
)


def test_the_first_composition_stays_what_it_was() -> None:
    assert load_composition("comprehensive") == RouteComposition("comprehensive")
    assert set(composition_names()) <= set(ROUTE_CYCLES)


@pytest.mark.parametrize("composition", [*SHIPPED, STEEP], ids=lambda entry: entry.name)
def test_every_composition_is_two_passes_of_5000_s_in_its_order(
    composition: RouteComposition,
) -> None:
    cycle, segments, _ = comprehensive_cycle(composition)
    assert cycle.duration_s == 10_000.0
    assert tuple(segment.cycle for segment in segments) == composition.order * 2
    assert segments[len(composition.order)].start_s == 5000.0
    # Five parts are odd, so that every part meets both kinds of hills.
    first, second = segments[:5], segments[5:]
    assert first[0].slope_kind == composition.first_slope
    assert all(a.slope_kind != b.slope_kind for a, b in zip(first, second, strict=True))
    for segment, before in zip(segments[1:], segments, strict=False):
        assert (segment.start_s, segment.start_m) == (before.end_s, before.end_m)
    for segment in segments:
        rows = slice(int(segment.start_s), int(segment.end_s) + 1)
        assert cycle.distances_m()[rows][-1] == segment.end_m
        if segment.cycle != "smooth":
            speeds = load_cycle(segment.cycle).speeds_m_s
            np.testing.assert_array_equal(cycle.speeds_m_s[rows], speeds)


def test_hills_reach_their_grade_on_top_of_the_climb() -> None:
    _, segments, road = comprehensive_cycle(STEEP)
    climb = np.arctan(0.02)
    for segment in segments:
        positions = np.linspace(segment.start_m, segment.end_m, 20_001)
        slopes = road.slope_at(positions)
        peak = np.arctan({"large": 0.16, "small": 0.05}[segment.slope_kind])
        assert np.max(np.abs(slopes - climb)) == pytest.approx(peak, rel=0.01)
        assert np.mean(slopes) == pytest.approx(climb, abs=2e-4)
    assert road.slope_at(-100.0) == pytest.approx(climb)


def test_the_smooth_part_keeps_its_speeds() -> None:
    cycle, segments, _ = comprehensive_cycle(STEEP)
    smooth = next(segment for segment in segments if segment.cycle == "smooth")
    speeds = 3.6 * cycle.speeds_m_s[int(smooth.start_s) + 90 : int(smooth.end_s) - 90]
    assert np.min(speeds) == pytest.approx(80.0, abs=0.1)
    assert np.max(speeds) == pytest.approx(110.0, abs=0.1)


def test_a_route_can_be_built_from_a_composition_of_ones_own() -> None:
    route = build_route(STEEP, initial_gap_m=15.0, duration_s=100.0)
    assert route.name == "steep, slope as_designed"
    assert route.slope.slope_at(-1.0) == pytest.approx(np.arctan(0.02))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"order": ("nycc", "nowhere", "smooth")}, "unknown part 'nowhere'"),
        ({"order": ("nycc", "us06")}, "smooth occurs 0 times"),
        ({"first_slope": "steep"}, "first_slope is 'steep'"),
        ({"large_grade": 0.4}, "large_grade is 0.4 (float); allowed: a number from 0 to 0.25"),
        ({"mean_climb": float("nan")}, "mean_climb is nan"),
        ({"smooth_low_km_h": 115.0}, "smooth_low_km_h is 115.0; allowed: at most"),
    ],
)
def test_what_makes_no_trip_is_refused(change: dict[str, object], text: str) -> None:
    with pytest.raises(RouteError, match="composition steep") as refusal:
        replace(STEEP, **change)  # type: ignore[arg-type]
    assert text in str(refusal.value)


def test_a_file_must_state_everything(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("order: [nycc, smooth]\nfirst_slope: large\n", encoding="utf-8")
    with pytest.raises(RouteError, match="'large_grade' is missing"):
        read_composition(path)

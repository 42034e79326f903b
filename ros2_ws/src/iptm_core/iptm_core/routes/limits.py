"""Speed limits that follow from the road or from what was driven on it."""

from __future__ import annotations

import numpy as np

from iptm_core.parameters.units import KM_H_PER_M_S
from iptm_core.road_ahead import SpeedLimits
from iptm_core.routes.leader import LeaderMotion
from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.state import FloatArray

LEGAL_KM_H = (30.0, 50.0, 60.0, 80.0, 100.0, 130.0)
"""Usual limits of towns, country roads and motorways."""
KEPT_WITHIN = 1.03
"""A limit counts as kept up to this share of it: WLTC reaches 131.3 km/h."""
HALT_M_S = 0.1
CURVE_CHORD_M = 25.0
"""Distance of the three points through which the circle of a curve is laid."""
CURVE_SPACING_M = 10.0
STRAIGHT_M_S = 60.0
"""Curves that allow more than this, beyond the speed of any car of the project, are not limits."""


def limits_of_drive(motion: LeaderMotion) -> SpeedLimits:
    """Return the limits of a road as a drive on it suggests them.

    Between two halts the limit is the lowest of `LEGAL_KM_H` that the drive keeps there; the parts of the
    published cycles are made for such classes of roads.
    """
    halted = motion.speeds_m_s <= HALT_M_S
    begins = np.flatnonzero(halted[:-1] & ~halted[1:])
    if not begins.size or (begins[0] > 0 and not halted[0]):
        begins = np.concatenate([[0], begins])
    fastest = np.maximum.reduceat(motion.speeds_m_s, begins)
    legal = np.array(LEGAL_KM_H) / KM_H_PER_M_S
    above = np.minimum(np.searchsorted(KEPT_WITHIN * legal, fastest), legal.size - 1)
    return SpeedLimits(motion.positions_m[begins], legal[above])


def limits_of_curves(
    line: RoadLine,
    lateral_m_s2: float,
    chord_m: float = CURVE_CHORD_M,
    spacing_m: float = CURVE_SPACING_M,
) -> SpeedLimits:
    """Return the speeds with which the curves of a road take a lateral acceleration.

    The radius is that of the circle through three points of the line (Menger's curvature), so a bend counts
    on the road around it, too.

    Args:
        line: where the road lies.
        lateral_m_s2: largest lateral acceleration, above 0.
        chord_m: distance of the three points.
        spacing_m: distance between two places that are looked at.
    """
    _, _, headings = line.locate(line.positions_m)
    if np.all(headings == headings[0]):
        return SpeedLimits(np.zeros(1), np.full(1, STRAIGHT_M_S))
    places: FloatArray = np.arange(0.0, line.length_m + spacing_m, spacing_m).astype(np.float64)
    latitudes, longitudes, _ = line.locate(places)
    origin = (latitudes, longitudes)
    before_e, before_n = east_north_m(*line.locate(places - chord_m)[:2], origin)
    after_e, after_n = east_north_m(*line.locate(places + chord_m)[:2], origin)
    doubled_area = np.abs(before_e * after_n - before_n * after_e)
    sides = np.hypot(before_e, before_n) * np.hypot(after_e, after_n)
    sides *= np.hypot(after_e - before_e, after_n - before_n)
    curvature = 2.0 * doubled_area / np.maximum(sides, 1e-9)
    speeds = np.minimum(np.sqrt(lateral_m_s2 / np.maximum(curvature, 1e-9)), STRAIGHT_M_S)
    changes = np.concatenate([[True], np.diff(speeds) != 0.0])
    return SpeedLimits(places[changes], speeds[changes])

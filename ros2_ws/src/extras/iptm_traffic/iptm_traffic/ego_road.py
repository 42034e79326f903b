"""The ego's way through a network of SUMO as a road: where things lie along it, slopes, speeds in its bends.

Positions along the road are SUMO's on the ego vehicle's lanes, junctions included, so that plant, SUMO
and messages speak of the same metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.road_ahead import SpeedLimits, limits_of_curves
from iptm_core.routes.road_line import RoadLine, step_deg
from iptm_core.routes.slope import SlopeProfile
from iptm_core.state import FloatArray
from iptm_traffic.sumo_net import Link, SumoNet

ORIGIN_DEG = (48.0, 10.0)
AROUND_M = (-150.0, 450.0)
"""How much of the road behind and ahead of the ego others are looked for on; it may pass one place again."""
SIDEWAYS_M_S2 = 2.0
"""Lateral acceleration that the ego vehicle keeps to in bends: comfortable for passengers."""
_SMALLEST_STEP_M = 0.05
_CHORD_M, _SPACING_M = 12.0, 4.0
"""Length over which curvature is measured, and distance between its samples: small enough for roundabouts."""


@dataclass(frozen=True, eq=False)
class EgoRoad:
    """The ego vehicle's way: its lanes one after the other.

    Attributes:
        east_m: vertices of the lanes in SUMO's plane, shape (n,), n >= 2.
        north_m: shape (n,).
        heights_m: shape (n,).
        positions_m: positions of the vertices along the road, shape (n,), from 0.
        lane_starts_m: positions of the beginnings of each lane of the way, junctions included, by its
            name; one for each pass.
        stop_lines_m: positions of the ends of the lanes at junctions, in driving order.
    """

    east_m: FloatArray
    north_m: FloatArray
    heights_m: FloatArray
    positions_m: FloatArray
    lane_starts_m: dict[str, tuple[float, ...]]
    stop_lines_m: tuple[float, ...]

    @classmethod
    def of_way(cls, net: SumoNet, way: tuple[Link, ...], start_m: float) -> EgoRoad:
        """Return the road of a way.

        Args:
            net: the network.
            way: links, one after the other, at least one.
            start_m: where on the first lane position 0 is.
        """
        names = [way[0].from_lane]
        for link in way:
            names += [*link.inside, link.to_lane]
        points: list[tuple[float, float, float]] = []
        positions: list[float] = [0.0]
        starts: dict[str, tuple[float, ...]] = {}
        ends: list[float] = []
        for name in names:
            lane = net.lanes[name]
            steps = np.sqrt(np.sum(np.diff(lane.shape_m, axis=0) ** 2, axis=1))
            # SUMO stretches a lane's shape to its length; its positions are along the length.
            steps *= lane.length_m / max(steps.sum(), _SMALLEST_STEP_M)
            starts[name] = (*starts.get(name, ()), positions[-1] - start_m)
            points.extend(map(tuple, lane.shape_m[1:] if points else lane.shape_m))
            positions.extend((positions[-1] + np.cumsum(steps)).tolist())
            if not name.startswith(":"):
                ends.append(positions[-1])
        along = np.array(positions) - start_m
        # Lanes across junctions may be no longer than a hand.
        kept = (along > 0.0) & (np.diff(along, prepend=-np.inf) > _SMALLEST_STEP_M)
        columns = np.array(points).T
        east, north, heights = (
            np.concatenate([[np.interp(0.0, along, values)], values[kept]]) for values in columns
        )
        return cls(
            east,
            north,
            heights,
            np.concatenate([[0.0], along[kept]]),
            starts,
            tuple(end_m - start_m for end_m in ends[:-1]),
        )

    @property
    def length_m(self) -> float:
        """Length of the road."""
        return float(self.positions_m[-1])

    def position_on(self, lane: str, on_lane_m: float, near_m: float) -> float | None:
        """Return the position along the road of a point on a lane, None if the road has no such lane.

        Of several passes the one nearest to `near_m` counts.
        """
        passes = [start_m + on_lane_m for start_m in self.lane_starts_m.get(lane, ())]
        return min(passes, key=lambda along_m: abs(along_m - near_m)) if passes else None

    def along_and_aside_m(
        self, east_m: FloatArray, north_m: FloatArray, near_m: float | None = None
    ) -> FloatArray:
        """Return position along the road and distance to its left of points, shape (2, m) of shape (m,).

        Args:
            east_m: of the points in SUMO's plane.
            north_m: of the same points.
            near_m: only the road around this position is looked at; None for all of it.
        """
        first, last = 0, self.positions_m.size - 1
        if near_m is not None:
            ends_m = (near_m + AROUND_M[0], near_m + AROUND_M[1])
            first, last = (int(index) for index in np.searchsorted(self.positions_m, ends_m))
            first, last = max(first - 1, 0), min(max(last, 1), self.positions_m.size - 1)
            first = min(first, last - 1)
        part_of = slice(first, last + 1)
        east, north, positions = (
            values[part_of] for values in (self.east_m, self.north_m, self.positions_m)
        )
        offset_e = east_m[:, None] - east[None, :-1]
        offset_n = north_m[:, None] - north[None, :-1]
        step_e, step_n = np.diff(east), np.diff(north)
        lengths = np.hypot(step_e, step_n)
        share = (offset_e * step_e + offset_n * step_n) / lengths**2
        # Both ends go on straight.
        share[:, 1:] = np.maximum(share[:, 1:], 0.0)
        share[:, :-1] = np.minimum(share[:, :-1], 1.0)
        away = np.hypot(offset_e - share * step_e, offset_n - share * step_n)
        best = np.argmin(away, axis=1)
        rows = np.arange(best.size)
        part = share[rows, best]
        along = positions[best] + part * np.diff(positions)[best]
        left = step_e[best] * offset_n[rows, best] - step_n[best] * offset_e[rows, best]
        return np.stack([along, left / lengths[best]])

    def road_line(self) -> RoadLine:
        """Return the road on Earth, with the positions of this way.

        A road with grades is longer than its map; here its map is stretched to the length of the road.
        """
        headings = np.arctan2(np.diff(self.east_m), np.diff(self.north_m))
        lengths = np.diff(self.positions_m)
        latitudes, longitudes = [ORIGIN_DEG[0]], [ORIGIN_DEG[1]]
        for length, heading in zip(lengths.tolist(), headings.tolist(), strict=True):
            latitude, longitude = step_deg(
                latitudes[-1], longitudes[-1], length * np.sin(heading), length * np.cos(heading)
            )
            latitudes.append(float(latitude))
            longitudes.append(float(longitude))
        return RoadLine(np.array(latitudes), np.array(longitudes))

    def slope(self) -> SlopeProfile:
        """Return the slope along the road."""
        return SlopeProfile.from_elevations(self.positions_m, self.heights_m)

    def limits(self, net: SumoNet) -> SpeedLimits:
        """Return the speed limits of its lanes, lowered where it bends."""
        lanes = {
            start_m: net.lanes[name].limit_m_s
            for name, starts_m in self.lane_starts_m.items()
            for start_m in starts_m
        }
        starts = np.array(sorted(lanes))
        signs = SpeedLimits(starts, np.array([lanes[start_m] for start_m in starts]))
        return signs.and_not_above(
            limits_of_curves(self.road_line(), SIDEWAYS_M_S2, _CHORD_M, _SPACING_M)
        )

"""The comprehensive 10^4 s driving cycle (paper Section IV), in any of its compositions.

One pass is the parts of the composition; its smooth section fills it to 5000 s. The pass is driven twice.
Large (L) and small (S) slope alternate from segment to segment; as a pass has an odd number of segments,
every segment meets both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from iptm_core.parameters.units import KM_H_PER_M_S
from iptm_core.routes.composition import (
    SLOPE_KINDS,
    SMOOTH,
    RouteComposition,
    load_composition,
)
from iptm_core.routes.cycles import DrivingCycle, load_cycle, smooth_cycle
from iptm_core.routes.hills import Hills
from iptm_core.routes.slope import SlopeProfile

PASS_DURATION_S = 5000
PASSES = 2


@dataclass(frozen=True)
class RouteSegment:
    """One stretch of a route: which cycle is driven there and how hilly it is.

    Attributes:
        name: what is driven, for example ``"1: us06 S"``.
        cycle: name of the driving cycle of this stretch.
        slope_kind: ``"flat"``, ``"small"``, ``"large"`` or ``"measured"``.
        start_s: time at which the leader enters it.
        end_s: time at which the leader leaves it.
        start_m: distance that the leader has travelled at ``start_s``; the stretch of road with
            this slope starts at the same road position (0 = start of the host).
        end_m: distance that the leader has travelled at ``end_s``.
    """

    name: str
    cycle: str
    slope_kind: str
    start_s: float
    end_s: float
    start_m: float
    end_m: float


@dataclass(frozen=True)
class ComprehensiveCycle:
    """The joined speed trace and its segments with their designed slope.

    Attributes:
        cycle: 10001 samples, 0 to 10000 s.
        segments: segments in driving order, ten with five parts.
        composition: what it is put together from.
    """

    cycle: DrivingCycle
    segments: tuple[RouteSegment, ...]
    composition: RouteComposition

    def slope_profile(self) -> SlopeProfile:
        """Road with the hills of every segment; both passes of a segment share one shape."""
        return hilly_road(self.segments, len(self.segments) // PASSES, self.composition)


def hilly_road(
    segments: Sequence[RouteSegment], shapes: int, composition: RouteComposition
) -> SlopeProfile:
    """Lay hills along segments, none where the slope is flat.

    Args:
        segments: stretches in driving order, each of them hilly or each flat.
        shapes: number of different shapes; they are used in turn.
        composition: grades, climb and length of the hills.
    """
    return SlopeProfile.from_hills(
        [
            Hills(
                segment.start_m,
                segment.end_m - segment.start_m,
                composition.grade(segment.slope_kind),
                variant=index % shapes,
                wavelength_m=composition.hill_length_m,
            )
            for index, segment in enumerate(segments)
            if segment.slope_kind in SLOPE_KINDS
        ],
        composition.mean_climb,
    )


@lru_cache(maxsize=32)
def comprehensive_cycle(composition: RouteComposition | None = None) -> ComprehensiveCycle:
    """Join the parts.

    All parts start and end at standstill, so neighbours share the sample at their joint.

    Args:
        composition: order and slopes; None takes ``comprehensive``.

    Returns:
        The cycle with its segments.

    Raises:
        RouteError: the published parts leave too little time for the smooth one.
    """
    composition = composition or load_composition("comprehensive")
    published = {name: load_cycle(name) for name in composition.order if name != SMOOTH}
    used_s = sum(int(published[name].duration_s) for name in composition.order if name != SMOOTH)
    smooth = smooth_cycle(
        PASS_DURATION_S - used_s,
        composition.smooth_low_km_h / KM_H_PER_M_S,
        composition.smooth_high_km_h / KM_H_PER_M_S,
    )
    parts = [{**published, SMOOTH: smooth}[name] for name in composition.order] * PASSES
    speeds = np.concatenate([parts[0].speeds_m_s[:1], *(part.speeds_m_s[1:] for part in parts)])
    cycle = DrivingCycle(
        composition.name,
        np.arange(speeds.size, dtype=np.float64),
        speeds,
        "twice: " + "; ".join(part.source for part in parts[: len(parts) // PASSES]),
    )
    distances = cycle.distances_m()
    ends = np.cumsum([0, *(int(part.duration_s) for part in parts)])
    first = SLOPE_KINDS.index(composition.first_slope)
    segments = []
    for index, part in enumerate(parts):
        kind = SLOPE_KINDS[(first + index) % len(SLOPE_KINDS)]
        start, end = int(ends[index]), int(ends[index + 1])
        segments.append(
            RouteSegment(
                name=f"{1 + PASSES * index // len(parts)}: {part.name} {kind[0].upper()}",
                cycle=part.name,
                slope_kind=kind,
                start_s=float(start),
                end_s=float(end),
                start_m=float(distances[start]),
                end_m=float(distances[end]),
            )
        )
    return ComprehensiveCycle(cycle, tuple(segments), composition)

"""The comprehensive 10^4 s driving cycle (paper Section IV), in this project's composition.

The paper names NYCC, WLTP, US06, SC03 and smooth sections, two slope conditions and two repetitions,
not their order. Here one pass is NYCC, SC03, WLTC class 3b, US06 and a smooth section that fills it
to 5000 s. The pass is driven twice. Large (L) and small (S) slope alternate from segment to
segment; as a pass has an odd number of segments, every segment meets both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from iptm_core.routes.cycles import DrivingCycle, load_cycle
from iptm_core.routes.hills import PEAK_GRADES, Hills
from iptm_core.routes.segment import RouteSegment
from iptm_core.routes.slope import SlopeProfile
from iptm_core.routes.smooth import smooth_cycle

PASS_DURATION_S = 5000
PASSES = 2
PUBLISHED_PARTS = ("nycc", "sc03", "wltc_class3b", "us06")

_KINDS = ("large", "small")


@dataclass(frozen=True)
class ComprehensiveCycle:
    """The joined speed trace and its segments with their designed slope.

    Attributes:
        cycle: 10001 samples, 0 to 10000 s.
        segments: ten segments in driving order.
    """

    cycle: DrivingCycle
    segments: tuple[RouteSegment, ...]

    def slope_profile(self) -> SlopeProfile:
        """Road with the hills of every segment; both passes of a segment share one shape."""
        parts = len(self.segments) // PASSES
        return SlopeProfile.from_hills(
            [
                Hills(
                    segment.start_m,
                    segment.end_m - segment.start_m,
                    PEAK_GRADES[segment.slope_kind],
                    variant=index % parts,
                )
                for index, segment in enumerate(self.segments)
            ]
        )


@cache
def comprehensive_cycle() -> ComprehensiveCycle:
    """Join the parts.

    All parts start and end at standstill, so neighbours share the sample at their joint.

    Returns:
        The cycle with its segments.
    """
    published = [load_cycle(name) for name in PUBLISHED_PARTS]
    used_s = sum(int(part.duration_s) for part in published)
    parts = [*published, smooth_cycle(PASS_DURATION_S - used_s)] * PASSES
    speeds = np.concatenate([parts[0].speeds_m_s[:1], *(part.speeds_m_s[1:] for part in parts)])
    cycle = DrivingCycle(
        "comprehensive",
        np.arange(speeds.size, dtype=np.float64),
        speeds,
        "twice: " + "; ".join(part.source for part in parts[: len(parts) // PASSES]),
    )
    distances = cycle.distances_m()
    ends = np.cumsum([0, *(int(part.duration_s) for part in parts)])
    segments = []
    for index, part in enumerate(parts):
        kind = _KINDS[index % len(_KINDS)]
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
    return ComprehensiveCycle(cycle, tuple(segments))

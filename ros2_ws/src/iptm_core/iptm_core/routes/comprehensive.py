"""The comprehensive 10^4 s driving cycle (paper Section IV) and its compositions.

One pass is the parts of the composition; its smooth section fills it to 5000 s. The pass is driven twice.
Large (L) and small (S) slope alternate from segment to segment; as a pass has an odd number of segments,
every segment meets both. The paper names NYCC, WLTP, US06, SC03 and smooth sections; order, hills, climb and
the speeds of the smooth section are not given, so a composition states them. Shipped ones lie in
``data/compositions``, one file each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes.cycles import CYCLE_NAMES, DrivingCycle, load_cycle, smooth_cycle
from iptm_core.routes.slope import MAIN_WAVELENGTH_M, PEAK_GRADES, Hills, SlopeProfile
from iptm_core.units import KM_H_PER_M_S
from iptm_core.user_input import StrictMapping, check_known

SMOOTH = "smooth"
SLOPE_KINDS = ("large", "small")
_SUFFIX = ".yaml"


@dataclass(frozen=True)
class RouteComposition(Settings):
    """How a comprehensive cycle is put together.

    Attributes:
        order: parts of a pass in driving order: published cycles, and ``"smooth"`` once.

    Raises:
        RouteError: an unknown part, or a value outside its range.
    """

    name: str
    order: tuple[str, ...] = ("nycc", "sc03", "wltc_class3b", "us06", SMOOTH)
    first_slope: str = parameter(
        "large",
        "kind of hills of the first part; the kinds alternate from part to part",
        choices=SLOPE_KINDS,
    )
    large_grade: float = parameter(
        PEAK_GRADES["large"], "steepest grade of the large hills, the climb left aside", "", 0, 0.25
    )
    small_grade: float = parameter(
        PEAK_GRADES["small"], "steepest grade of the small hills", "", 0, 0.25
    )
    mean_climb: float = parameter(0.0, "grade of the road under the hills", "", -0.05, 0.05)
    hill_length_m: float = parameter(
        MAIN_WAVELENGTH_M, "length of a hill; shorter on short parts", "m", 200.0, 20_000.0
    )
    smooth_low_km_h: float = parameter(
        60.0, "lowest speed of the smooth part between its ramps", "km/h", 20.0, 120.0
    )
    smooth_high_km_h: float = parameter(
        120.0, "highest speed of the smooth part", "km/h", 20.0, 135.0
    )

    def __post_init__(self) -> None:
        where = f"composition {self.name}"
        try:
            super().__post_init__()
        except ParameterError as reason:
            raise RouteError(f"{where}: {reason}") from None
        for part in self.order:
            check_known(part, (*CYCLE_NAMES, SMOOTH), where, "part", RouteError)
        if self.order.count(SMOOTH) != 1:
            raise RouteError(
                f"{where}: {SMOOTH} occurs {self.order.count(SMOOTH)} times; allowed: once, "
                "because it fills the pass"
            )
        if self.smooth_low_km_h > self.smooth_high_km_h:
            raise RouteError(
                f"{where}: smooth_low_km_h is {self.smooth_low_km_h}; "
                f"allowed: at most smooth_high_km_h, {self.smooth_high_km_h}"
            )

    def grade(self, slope_kind: str) -> float:
        """Steepest grade of a kind of hills."""
        return {"large": self.large_grade, "small": self.small_grade}[slope_kind]

    def to_dict(self) -> dict[str, Any]:
        """Plain values without the name, as a file holds them."""
        content = asdict(self)
        del content["name"]
        content["order"] = list(self.order)
        return content


@cache
def composition_names() -> tuple[str, ...]:
    """Names of the shipped compositions; each is the name of a cycle."""
    return tuple(sorted(path.stem for path in compositions_folder().glob(f"*{_SUFFIX}")))


@cache
def load_composition(name: str) -> RouteComposition:
    """Load a shipped composition."""
    if name not in composition_names():
        raise RouteError(f"unknown composition {name!r}; allowed: {', '.join(composition_names())}")
    return read_composition(compositions_folder() / f"{name}{_SUFFIX}")


def read_composition(path: Path) -> RouteComposition:
    """Read a composition from its file; the file name is its name."""
    keys = [entry.name for entry in fields(RouteComposition) if entry.name != "name"]
    written = StrictMapping(
        read_yaml(path, RouteError), str(path), ("description", *keys), error=RouteError
    )
    written.require(*keys)
    order = tuple(map(str, written.entries("order")))
    scalars = {key: written.scalar(key) for key in keys if key != "order"}
    return RouteComposition(path.stem, order, **scalars)  # type: ignore[arg-type]


def compositions_folder() -> Path:
    """Folder of the shipped compositions; the packages are installed as plain folders."""
    return Path(str(resources.files("iptm_core.routes") / "data" / "compositions"))


PASS_DURATION_S = 5000
PASSES = 2


@dataclass(frozen=True)
class RouteSegment:
    """One stretch of a route: which cycle is driven there and how hilly it is.

    Attributes:
        name: of the segment, for example ``"1: us06 S"``.
        slope_kind: ``"flat"``, ``"small"``, ``"large"`` or ``"measured"``.
        start_m: distance that the leader has travelled at ``start_s``; the stretch of road with
            this slope starts at the same road position (0 = start of the ego vehicle).
    """

    name: str
    cycle: str
    slope_kind: str
    start_s: float
    end_s: float
    start_m: float
    end_m: float


def hilly_road(
    segments: Sequence[RouteSegment], shapes: int, composition: RouteComposition
) -> SlopeProfile:
    """Lay hills along segments, none where the slope is flat; of ``shapes`` different ones, in turn."""
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
def comprehensive_cycle(
    composition: RouteComposition | None = None,
) -> tuple[DrivingCycle, tuple[RouteSegment, ...], SlopeProfile]:
    """Return the joined speed trace (0 to 10000 s), its segments in driving order, and its road.

    All parts start and end at standstill, so neighbours share the sample at their joint. Both passes of a
    segment have hills of one shape.

    Args:
        composition: order and slopes; None takes ``comprehensive``.
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
    road = hilly_road(segments, len(segments) // PASSES, composition)
    return cycle, tuple(segments), road

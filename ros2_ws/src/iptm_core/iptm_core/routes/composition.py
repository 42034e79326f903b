"""Compositions of the comprehensive cycle as data: what the paper leaves open about its trip, by name.

The paper names NYCC, WLTP, US06, SC03 and smooth sections, two slope conditions and two repetitions of
10^4 s in all; order, hills, climb and the speeds of the smooth section are not given. A composition states
them. Shipped ones lie in ``data/compositions``, one file each.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from iptm_core.errors import RouteError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.routes.hills import MAIN_WAVELENGTH_M, PEAK_GRADES
from iptm_core.strict_mapping import StrictMapping

SMOOTH = "smooth"
SLOPE_KINDS = ("large", "small")
_RANGES = {
    "large_grade": (0.0, 0.25),
    "small_grade": (0.0, 0.25),
    "mean_climb": (-0.05, 0.05),
    "hill_length_m": (200.0, 20_000.0),
    "smooth_low_km_h": (20.0, 120.0),
    "smooth_high_km_h": (20.0, 135.0),
}
_SUFFIX = ".yaml"


@dataclass(frozen=True)
class RouteComposition:
    """How a comprehensive cycle is put together.

    Attributes:
        name: short name.
        order: parts of a pass in driving order: published cycles, and ``"smooth"`` once.
        first_slope: kind of hills of the first part; the kinds alternate from part to part.
        large_grade: steepest grade of the large hills, rise over run, the climb left aside.
        small_grade: the same of the small ones.
        mean_climb: grade of the whole road under the hills.
        hill_length_m: length of a hill; shorter on short parts.
        smooth_low_km_h: lowest speed of the smooth part between its ramps.
        smooth_high_km_h: highest speed of the smooth part.

    Raises:
        RouteError: an unknown part, or a value outside its range.
    """

    name: str
    order: tuple[str, ...] = ("nycc", "sc03", "wltc_class3b", "us06", SMOOTH)
    first_slope: str = "large"
    large_grade: float = PEAK_GRADES["large"]
    small_grade: float = PEAK_GRADES["small"]
    mean_climb: float = 0.0
    hill_length_m: float = MAIN_WAVELENGTH_M
    smooth_low_km_h: float = 60.0
    smooth_high_km_h: float = 120.0

    def __post_init__(self) -> None:
        for part in self.order:
            if part not in (*CYCLE_NAMES, SMOOTH):
                raise RouteError(
                    f"composition {self.name}: part is {part!r}; allowed: {', '.join(CYCLE_NAMES)}, {SMOOTH}"
                )
        if self.order.count(SMOOTH) != 1:
            raise RouteError(
                f"composition {self.name}: {SMOOTH} occurs {self.order.count(SMOOTH)} times; allowed: once, "
                "because it fills the pass"
            )
        if self.first_slope not in SLOPE_KINDS:
            raise RouteError(
                f"composition {self.name}: first_slope is {self.first_slope!r}; "
                f"allowed: {', '.join(SLOPE_KINDS)}"
            )
        for key, (low, high) in _RANGES.items():
            value = getattr(self, key)
            if not (math.isfinite(value) and low <= value <= high):
                raise RouteError(
                    f"composition {self.name}: {key} is {value}; allowed: {low:g} to {high:g}"
                )
        if self.smooth_low_km_h > self.smooth_high_km_h:
            raise RouteError(
                f"composition {self.name}: smooth_low_km_h is {self.smooth_low_km_h}; "
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
    """Load a shipped composition.

    Raises:
        RouteError: no such composition, or its file is not as it should be.
    """
    if name not in composition_names():
        raise RouteError(f"unknown composition {name!r}; allowed: {', '.join(composition_names())}")
    return read_composition(compositions_folder() / f"{name}{_SUFFIX}")


def read_composition(path: Path) -> RouteComposition:
    """Read a composition from its file; the file name is its name.

    Raises:
        RouteError: the file is not as it should be.
    """
    keys = [entry.name for entry in fields(RouteComposition) if entry.name != "name"]
    written = StrictMapping(
        read_yaml(path, RouteError), str(path), ("description", *keys), error=RouteError
    )
    written.require(*keys)
    numbers = {key: written.number(key) for key in _RANGES}
    order = tuple(str(part) for part in written.entries("order"))
    first = written.choice("first_slope", SLOPE_KINDS)
    return RouteComposition(path.stem, order, first, **numbers)


def compositions_folder() -> Path:
    """Folder of the shipped compositions; the packages are installed as plain folders."""
    return Path(str(resources.files("iptm_core.routes") / "data" / "compositions"))

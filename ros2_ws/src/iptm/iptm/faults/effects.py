"""What each kind of fault does to one measured value at one tick; None means that nothing arrives.

Random numbers come from the generator of the fault and the tick, so that the node and the loop without ROS
draw the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_core.units import CELSIUS_ZERO_K

if TYPE_CHECKING:
    from iptm.faults.fault import Fault

Motion = TypeVar("Motion", LeaderState, VehicleState)

_CELL_N = "cell_n_temperature_k"
_TEMPERATURES = ("cell_1_temperature_k", _CELL_N)
_ERRORS = 1
"""Stream of random numbers for errors; whether a tick is hit is drawn from another one."""


@dataclass(frozen=True)
class Hit:
    """A fault that hits at a tick.

    Attributes:
        ego_position_m: true position of the ego vehicle, for faults of the lead vehicle.
        first: the first preview, leader or state that the fault hit, for faults that repeat it.
        first_ego_position_m: where the ego vehicle was then.
    """

    fault: Fault
    time_ns: int
    ego_position_m: float = math.nan
    first: Any = None
    first_ego_position_m: float = math.nan

    @property
    def size(self) -> float:
        """Size of the fault in the unit of its kind."""
        return self.fault.magnitude

    def anywhere_m(self) -> float:
        """Return a random distance up to the size, to either side."""
        return float(self.fault.random(self.time_ns).uniform(-self.size, self.size))

    def any_node(self, preview: LeaderPreview) -> int:
        """Return a random node of a preview, but for the first and the last one."""
        return 1 + int(self.fault.random(self.time_ns).integers(preview.times_s.size - 2))


Effect = Callable[[Hit, Any], Any]
"""Of a hit and the measured value, to what arrives instead."""


def lost(*_: object) -> None:
    """Leave the measurement out."""


# --- previews; they are not empty


def empty_preview(*_: object) -> LeaderPreview:
    """Return a preview without points."""
    return LeaderPreview.empty()


def stale_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Return the first preview as it was generated."""
    return hit.first or preview


def frozen_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Return the first preview as if it were generated now."""
    if preview.times_s.size == 0:
        return preview
    first = hit.first or preview
    return _moved_in_time(first, preview.generated_at_s - first.generated_at_s)


def future_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Return a preview generated after its publication."""
    return _moved_in_time(preview, hit.time_ns / NS_PER_S + hit.size - preview.generated_at_s)


def extrapolated_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Return a preview from the first point on with the acceleration of the fault, down to standstill."""
    if preview.times_s.size == 0:
        return preview
    elapsed_s = preview.times_s - preview.times_s[0]
    speed_m_s, acceleration_m_s2 = float(preview.speeds_m_s[0]), hit.size
    if acceleration_m_s2 < 0.0:
        elapsed_s = np.minimum(elapsed_s, speed_m_s / -acceleration_m_s2)
    return replace(
        preview,
        positions_m=preview.positions_m[0]
        + elapsed_s * (speed_m_s + 0.5 * acceleration_m_s2 * elapsed_s),
        speeds_m_s=np.maximum(speed_m_s + acceleration_m_s2 * elapsed_s, 0.0),
    )


def unordered_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Swap the times of two neighbouring points, the first one excepted."""
    if preview.times_s.size < 3:
        return LeaderPreview.empty()
    node, times_s = hit.any_node(preview), preview.times_s.copy()
    times_s[[node, node + 1]] = times_s[[node + 1, node]]
    return replace(preview, times_s=times_s)


def nan_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Make one position NaN, the first one excepted."""
    if preview.times_s.size < 3:
        return LeaderPreview.empty()
    positions_m = preview.positions_m.copy()
    positions_m[hit.any_node(preview)] = np.nan
    return replace(preview, positions_m=positions_m)


def jumping_preview(hit: Hit, preview: LeaderPreview) -> LeaderPreview:
    """Move all points but the first by one random distance; positions never decrease."""
    positions_m = preview.positions_m.copy()
    positions_m[1:] += hit.anywhere_m()
    return replace(preview, positions_m=np.maximum.accumulate(positions_m))


def _moved_in_time(preview: LeaderPreview, by_s: float) -> LeaderPreview:
    if preview.times_s.size == 0:
        return preview
    times_s = preview.times_s + by_s
    return replace(preview, times_s=times_s)


# --- measured lead or ego vehicle


def nan_speed(_: Hit, motion: Motion) -> Motion:
    """Make the speed NaN."""
    return replace(motion, speed_m_s=np.nan)


def jumping(hit: Hit, motion: Motion) -> Motion:
    """Measure the vehicle a random distance away from where it is."""
    return replace(motion, position_m=motion.position_m + hit.anywhere_m())


def overlapping(hit: Hit, leader: LeaderState) -> LeaderState:
    """Measure the lead vehicle behind the front of the ego vehicle."""
    return replace(leader, position_m=hit.ego_position_m - hit.size)


def frozen_leader(hit: Hit, leader: LeaderState) -> LeaderState:
    """Measure the gap and the speed of the first time again."""
    first = hit.first or leader
    gap_m = first.position_m - hit.first_ego_position_m
    return LeaderState(leader.time_s, hit.ego_position_m + gap_m, first.speed_m_s)


def rounded_gap(hit: Hit, leader: LeaderState) -> LeaderState:
    """Measure the gap in steps of the size."""
    gap_m = hit.size * round((leader.position_m - hit.ego_position_m) / hit.size)
    return replace(leader, position_m=hit.ego_position_m + gap_m)


def rounded_speed(hit: Hit, leader: LeaderState) -> LeaderState:
    """Measure the speed in steps of the size."""
    return replace(leader, speed_m_s=hit.size * round(leader.speed_m_s / hit.size))


def noise(*names: str) -> Effect:
    """Return an effect that adds independent white Gaussian noise to attributes."""

    def noisy(hit: Hit, motion: Motion) -> Motion:
        errors = hit.fault.random(hit.time_ns, _ERRORS).normal(0.0, hit.size, len(names))
        return _shifted(motion, dict(zip(names, errors.tolist(), strict=True)))

    return noisy


def bias(*names: str) -> Effect:
    """Return an effect that adds the size to attributes."""
    return lambda hit, motion: _shifted(motion, dict.fromkeys(names, hit.size))


def _shifted(motion: Motion, errors: dict[str, float]) -> Motion:
    return replace(motion, **{name: getattr(motion, name) + by for name, by in errors.items()})


temperature_noise, temperature_bias = noise(*_TEMPERATURES), bias(*_TEMPERATURES)
cell_n_temperature_bias = bias(_CELL_N)


def reading(*names: str) -> Effect:
    """Return an effect that measures temperatures at the size of the fault (degC)."""
    return lambda hit, state: replace(state, **dict.fromkeys(names, hit.size + CELSIUS_ZERO_K))


def unknown(*names: str) -> Effect:
    """Return an effect that makes attributes NaN."""
    return lambda _, state: replace(state, **dict.fromkeys(names, math.nan))


def stuck(*names: str) -> Effect:
    """Return an effect that measures attributes as the first time."""
    return lambda hit, state: replace(
        state, **{name: getattr(hit.first or state, name) for name in names}
    )


both_cells_read, cell_n_reads = reading(*_TEMPERATURES), reading(_CELL_N)
both_cells_nan, cell_n_nan = unknown(*_TEMPERATURES), unknown(_CELL_N)
both_cells_stuck, cell_n_stuck = stuck(*_TEMPERATURES), stuck(_CELL_N)


# --- map of the road: slopes in rad


def steeper_slope(hit: Hit, slopes_rad: FloatArray) -> FloatArray:
    """Add the size to every slope."""
    return slopes_rad + hit.size


def nan_slope(hit: Hit, slopes_rad: FloatArray) -> FloatArray:
    """Make one slope NaN, the same one as long as the fault lasts."""
    changed = slopes_rad.copy()
    changed[int(hit.fault.random(hit.fault.start_ns).integers(slopes_rad.size))] = np.nan
    return changed

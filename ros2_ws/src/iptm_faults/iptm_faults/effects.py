"""What each kind of fault does to one measured value at one tick; None means that nothing arrives.

Every function takes the fault and the tick first. Random numbers come from the generator of the fault and
the tick, so that the node and the loop without ROS draw the same ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState, VehicleState

if TYPE_CHECKING:
    from iptm_faults.fault import Fault

Motion = TypeVar("Motion", LeaderState, VehicleState)
PreviewEffect = Callable[["Fault", int, LeaderPreview, LeaderPreview], LeaderPreview | None]
"""Of fault, tick, preview and the first preview that the fault hit; no preview is empty."""
LeaderEffect = Callable[["Fault", int, LeaderState, float], LeaderState | None]
"""Of fault, tick, leader and true position of the ego vehicle in m."""
StateEffect = Callable[["Fault", int, VehicleState], VehicleState]
SlopeEffect = Callable[["Fault", FloatArray], FloatArray]
"""Of fault and the slopes of the map in rad."""

_TEMPERATURES = ("cell_1_temperature_k", "cell_n_temperature_k")
_ERRORS = 1
"""Stream of random numbers for errors; whether a tick is hit is drawn from another one."""


# --- previews


def lost_preview(*_: object) -> None:
    """Leave a preview out."""


def empty_preview(*_: object) -> LeaderPreview:
    """Return a preview without points."""
    return LeaderPreview.empty()


def stale_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Return the first preview as it was generated."""
    del fault, time_ns, preview
    return first


def frozen_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Return the first preview as if it were generated now."""
    del fault, time_ns
    if preview.times_s.size == 0:
        return preview
    return _moved_in_time(first, preview.generated_at_s - first.generated_at_s)


def future_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Return a preview generated after its publication."""
    del first
    return _moved_in_time(preview, time_ns / NS_PER_S + fault.magnitude - preview.generated_at_s)


def extrapolated_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Return a preview from the first point on with the acceleration of the fault, down to standstill."""
    del time_ns, first
    if preview.times_s.size == 0:
        return preview
    elapsed_s = preview.times_s - preview.times_s[0]
    speed_m_s, acceleration_m_s2 = float(preview.speeds_m_s[0]), fault.magnitude
    if acceleration_m_s2 < 0.0:
        elapsed_s = np.minimum(elapsed_s, speed_m_s / -acceleration_m_s2)
    return replace(
        preview,
        positions_m=preview.positions_m[0]
        + elapsed_s * (speed_m_s + 0.5 * acceleration_m_s2 * elapsed_s),
        speeds_m_s=np.maximum(speed_m_s + acceleration_m_s2 * elapsed_s, 0.0),
    )


def unordered_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Swap the times of two neighbouring points, the first one excepted."""
    del first
    if preview.times_s.size < 3:
        return LeaderPreview.empty()
    node, times_s = _any_node(fault, time_ns, preview), preview.times_s.copy()
    times_s[[node, node + 1]] = times_s[[node + 1, node]]
    return replace(preview, times_s=times_s)


def nan_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Make one position NaN, the first one excepted."""
    del first
    if preview.times_s.size < 3:
        return LeaderPreview.empty()
    positions_m = preview.positions_m.copy()
    positions_m[_any_node(fault, time_ns, preview)] = np.nan
    return replace(preview, positions_m=positions_m)


def jumping_preview(
    fault: Fault, time_ns: int, preview: LeaderPreview, first: LeaderPreview
) -> LeaderPreview:
    """Move all points but the first by one random distance; positions never decrease."""
    del first
    positions_m = preview.positions_m.copy()
    positions_m[1:] += _anywhere_m(fault, time_ns)
    return replace(preview, positions_m=np.maximum.accumulate(positions_m))


def _moved_in_time(preview: LeaderPreview, by_s: float) -> LeaderPreview:
    if preview.times_s.size == 0:
        return preview
    times_s = preview.times_s + by_s
    return replace(preview, generated_at_s=float(times_s[0]), times_s=times_s)


def _anywhere_m(fault: Fault, time_ns: int) -> float:
    return float(fault.random(time_ns).uniform(-fault.magnitude, fault.magnitude))


def _any_node(fault: Fault, time_ns: int, preview: LeaderPreview) -> int:
    return 1 + int(fault.random(time_ns).integers(preview.times_s.size - 2))


# --- measured lead vehicle


def lost_leader(*_: object) -> None:
    """Leave the measurement out."""


def nan_leader(
    fault: Fault, time_ns: int, leader: LeaderState, ego_position_m: float
) -> LeaderState:
    """Make the speed NaN."""
    del fault, time_ns, ego_position_m
    return replace(leader, speed_m_s=np.nan)


def overlapping_leader(
    fault: Fault, time_ns: int, leader: LeaderState, ego_position_m: float
) -> LeaderState:
    """Measure it behind the front of the ego vehicle."""
    del time_ns
    return replace(leader, position_m=ego_position_m - fault.magnitude)


def jumping_leader(
    fault: Fault, time_ns: int, leader: LeaderState, ego_position_m: float
) -> LeaderState:
    """Measure it a random distance away from where it is."""
    del ego_position_m
    return _jumped(fault, time_ns, leader)


def leader_noise(name: str) -> LeaderEffect:
    """Return an effect that adds white noise to an attribute of the lead vehicle."""
    noisy = state_noise(name)
    return lambda fault, time_ns, leader, _: noisy(fault, time_ns, leader)


def leader_bias(name: str) -> LeaderEffect:
    """Return an effect that adds the size to an attribute of the lead vehicle."""
    biased = state_bias(name)
    return lambda fault, time_ns, leader, _: biased(fault, time_ns, leader)


# --- measured ego vehicle


def nan_state(fault: Fault, time_ns: int, state: VehicleState) -> VehicleState:
    """Make the speed NaN."""
    del fault, time_ns
    return replace(state, speed_m_s=np.nan)


def overheated_state(fault: Fault, time_ns: int, state: VehicleState) -> VehicleState:
    """Measure both cells at the temperature of the fault."""
    del time_ns
    hot_k = fault.magnitude + CELSIUS_ZERO_K
    return replace(state, **dict.fromkeys(_TEMPERATURES, hot_k))


def _jumped(fault: Fault, time_ns: int, motion: Motion) -> Motion:
    return replace(motion, position_m=motion.position_m + _anywhere_m(fault, time_ns))


def jumping_state(fault: Fault, time_ns: int, state: VehicleState) -> VehicleState:
    """Measure the ego vehicle a random distance away from where it is."""
    return _jumped(fault, time_ns, state)


def _shifted(motion: Motion, errors: dict[str, float]) -> Motion:
    return replace(motion, **{name: getattr(motion, name) + by for name, by in errors.items()})


def state_noise(*names: str) -> Callable[[Fault, int, Motion], Motion]:
    """Return an effect that adds independent white Gaussian noise to attributes."""

    def noisy(fault: Fault, time_ns: int, motion: Motion) -> Motion:
        errors = fault.random(time_ns, _ERRORS).normal(0.0, fault.magnitude, len(names))
        return _shifted(motion, dict(zip(names, errors.tolist(), strict=True)))

    return noisy


def state_bias(*names: str) -> Callable[[Fault, int, Motion], Motion]:
    """Return an effect that adds the size to attributes."""
    return lambda fault, _, motion: _shifted(motion, dict.fromkeys(names, fault.magnitude))


temperature_noise = state_noise(*_TEMPERATURES)
temperature_bias = state_bias(*_TEMPERATURES)


# --- map of the road


def steeper_slope(fault: Fault, slopes_rad: FloatArray) -> FloatArray:
    """Add the size to every slope."""
    return slopes_rad + fault.magnitude


def nan_slope(fault: Fault, slopes_rad: FloatArray) -> FloatArray:
    """Make one slope NaN, the same one as long as the fault lasts."""
    changed = slopes_rad.copy()
    changed[int(fault.random(fault.start_ns).integers(slopes_rad.size))] = np.nan
    return changed

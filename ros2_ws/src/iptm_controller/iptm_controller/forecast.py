"""Forecast of the leader's motion for the optimiser: measured past, predicted future, and its quality.

A preview is used only if it is well formed and recent enough; beyond its end the leader keeps its last speed.
It is trusted as far as its bounds allow, and up to the horizon that earlier previews justify. From
there on the plan follows the expected motion and keeps its braking reserve. Without a preview the leader is
extrapolated: its measured acceleration decays. Which of these holds, and why, is part of the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from iptm_controller.lead_check import (
    LARGEST_SPEED_ERROR_M_S,
)
from iptm_controller.preview_trust import (
    FusionMemory,
    TrustMemory,
)
from iptm_core.state import (
    SPEED_AT_REST_M_S,
    TOLERANCE_S,
    LeaderPreview,
    LeaderState,
)

HISTORY_S = 3.0
MAX_LEADER_SPEED_M_S = 100.0
NEAR_S = 3.0
"""Where the trusted horizon is shorter than this, the measured motion limits the forecast up to here."""


class PreviewQuality(IntEnum):
    """Quality of the preview."""

    FULL = 0
    """A valid preview, known over the whole horizon."""
    SHORT = 1
    """A valid preview that ends inside the horizon (constant speed beyond it), or is known up to there."""
    STALE = 2
    """The newest preview is too old; the measured motion is extrapolated."""
    MISSING = 3
    """No preview has been received; the measured motion is extrapolated."""
    INVALID = 4
    """The preview is malformed or contradicts the measurements; the measured motion is extrapolated."""
    DOUBTED = 5
    """A valid preview, but it or earlier ones were wrong; trusted up to a shorter horizon."""


@dataclass(frozen=True)
class LeaderForecast:
    """Motion of the leader around now.

    Attributes:
        motion: past and future, one piece.
        limiting: motion that the gap limits hold for: less its bounds as far as it is known, and at the first
            node in any case.
        quality: how the future is known.
        reason: one sentence, empty while the quality is full.
        age_s: age of the preview used, NaN without one.
        known_s: how far ahead the motion is known by a trusted preview; 0 where it is extrapolated.
    """

    motion: LeaderPreview
    limiting: LeaderPreview
    quality: PreviewQuality
    reason: str
    age_s: float
    known_s: float


def preview_fault(preview: LeaderPreview) -> str:
    """Return the fault of a preview in length, order, finiteness or plausibility, empty for none."""
    times, positions, speeds = preview.times_s, preview.positions_m, preview.speeds_m_s
    sizes = (times.size, positions.size, speeds.size)
    if len(set(sizes)) != 1:
        return f"preview has {sizes} times, positions and speeds; allowed: equal numbers"
    for label, values in (("time", times), ("position", positions), ("speed", speeds)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = _first(~finite)
            return f"preview {label} is {values[bad]} at node {bad}; allowed: finite values"
    with np.errstate(over="ignore"):
        passed_s, moved_m = times[1:] - times[:-1], positions[1:] - positions[:-1]
        halts, backwards = passed_s <= 0.0, moved_m < SPEED_AT_REST_M_S * np.maximum(passed_s, 1.0)
        leaps = moved_m > 1.0 + MAX_LEADER_SPEED_M_S * passed_s
    if halts.any():
        return f"preview times do not increase after node {_first(halts)}"
    if backwards.any():
        return f"preview positions move backwards after node {_first(backwards)}"
    if leaps.any():
        return (
            f"preview positions leap after node {_first(leaps)}; "
            f"allowed: {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    if speeds.size and not (
        speeds.min() >= SPEED_AT_REST_M_S and speeds.max() <= MAX_LEADER_SPEED_M_S
    ):
        return (
            f"preview speed is {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"allowed: {SPEED_AT_REST_M_S:g} to {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    return _bounds_fault(preview)


def _bounds_fault(preview: LeaderPreview) -> str:
    bounds = preview.bounds_m
    if bounds.size not in {0, preview.times_s.size}:
        return f"preview has {bounds.size} bounds; allowed: 0 or {preview.times_s.size}"
    if bounds.size and not (bounds.min() >= 0.0 and bounds.max() < np.inf):
        return f"preview bound is {bounds.min():g} to {bounds.max():g} m; allowed: finite values from 0 m"
    return ""


def doubted(trusted_s: float) -> str:
    """Return the reason of a shorter horizon."""
    return f"previews were wrong; trusted for {trusted_s:g} s"


def _first(flags: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(flags)[0])


def assessed(
    leader: LeaderState, preview: LeaderPreview, max_age_s: float, horizon_s: float
) -> tuple[PreviewQuality, str]:
    """Return the quality of a preview without regard to earlier ones, and the reason, empty if full."""
    if preview.times_s.size == 0:
        return PreviewQuality.MISSING, "no preview of the leader received yet"
    fault = preview_fault(preview)
    if fault:
        return PreviewQuality.INVALID, fault
    age_s = leader.time_s - preview.generated_at_s
    if age_s > max_age_s:
        reason = f"preview is {age_s:.1f} s old; allowed: up to {max_age_s:g} s"
        return PreviewQuality.STALE, reason
    if age_s < -TOLERANCE_S:
        return PreviewQuality.INVALID, f"preview was generated {-age_s:.3f} s in the future"
    last_s = float(preview.times_s[-1])
    if last_s <= leader.time_s:
        return PreviewQuality.STALE, f"preview ended {leader.time_s - last_s:.1f} s ago"
    predicted_m_s = float(np.interp(leader.time_s, preview.times_s, preview.speeds_m_s))
    if abs(predicted_m_s - leader.speed_m_s) > LARGEST_SPEED_ERROR_M_S:
        return PreviewQuality.INVALID, (
            f"preview is {predicted_m_s - leader.speed_m_s:+.1f} m/s off the measured speed, "
            f"more than {LARGEST_SPEED_ERROR_M_S:g} m/s"
        )
    until_s = min(last_s, preview.known_until_s)
    if until_s < leader.time_s + horizon_s - TOLERANCE_S:
        verb = "is known for" if until_s < last_s else "covers"
        ahead_s = max(until_s - leader.time_s, 0.0)
        return (
            PreviewQuality.SHORT,
            f"preview {verb} {ahead_s:.1f} s of a {horizon_s:g} s horizon",
        )
    return PreviewQuality.FULL, ""


ForecastMemory = tuple[tuple[LeaderState, ...], FusionMemory, TrustMemory]
"""Leader measured in the last seconds, oldest first; average of the previews, and trust in them."""

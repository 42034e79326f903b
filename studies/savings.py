"""What every saving is stated with: the road that it takes, the preview that it needs, and its two bases.

A long distance saves by itself, and no radio gives perfect foresight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

import iptm
from iptm_core.metrics import RunMetrics, at_equal_end
from iptm_core.metrics.saving import saved_percent
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory

MOVING_M_S = 5.0
"""Headways count above this speed."""
CAR_LENGTH_M = 4.5
PRODUCTION, PRODUCTION_SIMPLE = "production", "production_simple"
BASELINE, RULE_PREVIEW = "eco_acc", "rule_preview"
BASES = (PRODUCTION, BASELINE)
"""A car of today, and a strong baseline without V2X and without an optimisation."""
PREVIEWS = {False: "none", True: "60 s, perfect"}
COLUMNS = (
    ("distance", "{distance}"),
    ("preview", "{preview}"),
    ("mean gap:", "{gap_m:.1f} m"),
    ("headway, mean / median:", "{mean_headway_s:.2f} / {headway_s:.2f} s"),
    ("vehicles/(h lane):", "{vehicles_h:.0f}"),
    ("ageing saved:", "{production_ageing:.1f} %"),
    ("energy saved:", "{production_energy:.1f} %"),
    ("against `eco_acc`:", "{eco_acc_ageing:.1f} / {eco_acc_energy:.1f} %"),
)
"""Headings and formats of every table of savings, after the columns of trip and control."""
RULE_COLUMN = (
    "against `rule_preview`:",
    "{rule_preview_ageing:.1f} / {rule_preview_energy:.1f} %",
)
"""What an optimisation saves beyond a formula that has the same preview."""
KEPT_COLUMN = (
    "below s_min, longest, deepest:",
    "{below_s:.0f} s, {longest_s:.0f} s, {deepest_m:.1f} m",
)


def road_taken(runs: Sequence[Trajectory], begin: int = 0) -> dict[str, float]:
    """Return the road that a vehicle takes on some trips.

    Args:
        runs: the trips.
        begin: number of rows at the beginning of each that do not count; nor do rows without a lead vehicle.

    Returns:
        ``gap_m``, mean; ``mean_headway_s`` and its median ``headway_s`` above `MOVING_M_S` (NaN without
        such rows); ``vehicles_h`` per hour and lane at the mean speed and gap.
    """
    gap_m, speed_m_s = (
        np.concatenate([getattr(run, name)[begin:][run.has_leader[begin:]] for run in runs])
        for name in ("gap_m", "speed_m_s")
    )
    moving = speed_m_s > MOVING_M_S
    headways_s = gap_m[moving] / speed_m_s[moving] if moving.any() else np.array([np.nan])
    return {
        "gap_m": float(gap_m.mean()),
        "mean_headway_s": float(headways_s.mean()),
        "headway_s": float(np.median(headways_s)),
        "vehicles_h": float(3600.0 * speed_m_s.mean() / (gap_m.mean() + CAR_LENGTH_M)),
    }


def below_s_min(run: iptm.Run) -> dict[str, float]:
    """Return how long a run was below s_min, its longest stretch, and how deep."""
    following = run.metrics.following
    return {
        "below_s": following.below_s,
        "longest_s": following.longest_below_s,
        "deepest_m": max(-following.smallest_margin_m, 0.0),
    }


def saved(
    own: Sequence[RunMetrics], base: Sequence[RunMetrics], parameters: ModelParameters
) -> dict[str, float]:
    """Return what trips save against others, in percent, each pair brought to one end.

    Args:
        own: the trips.
        base: those with which they are compared, in the same order.
        parameters: of the vehicle.

    Returns:
        ``ageing``, capacity lost by both cells, and ``energy`` of the battery per distance; NaN where a
        pair has no common end at the lower limit of the temperature or above.
    """
    ends = [at_equal_end(*pair, parameters) for pair in zip(own, base, strict=True)]
    coldest_k = parameters.limits.min_temperature_k
    pairs = [end for end in ends if end is not None and end[0].temperature_k >= coldest_k]
    if len(pairs) < len(ends):
        return {"ageing": math.nan, "energy": math.nan}
    lost, used_j = (
        [math.fsum(getattr(pair[side], name) for pair in pairs) for side in (0, 1)]
        for name in ("capacity_loss", "energy_j")
    )
    driven_m = [math.fsum(run.distance_m for run in runs) for runs in (own, base)]
    consumed = [energy_j / length_m for energy_j, length_m in zip(used_j, driven_m, strict=True)]
    return {
        "ageing": saved_percent(*lost),
        "energy": saved_percent(*consumed),
    }


def savings(
    own: Sequence[RunMetrics],
    bases: Mapping[str, Sequence[RunMetrics]],
    parameters: ModelParameters,
) -> dict[str, float]:
    """Return the savings against some bases, by the name of the base and of the saving."""
    return {
        f"{name}_{kind}": percent
        for name, base in bases.items()
        for kind, percent in saved(own, base, parameters).items()
    }

"""What every saving is stated with: the road that it takes, the preview that it needs, and its two bases.

A long distance saves by itself, and no radio gives perfect foresight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iptm_core.metrics.following import MOVING_M_S
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.metrics.saving import at_equal_end
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory

CAR_LENGTH_M = 4.5
PRODUCTION, PRODUCTION_SIMPLE = "production", "production_simple"
BASELINE, RULE_PREVIEW = "eco_acc", "rule_preview"
BASES = (PRODUCTION, BASELINE)
"""A car of today, and a strong baseline without V2X and without an optimisation."""
PREVIEWS = {False: "none", True: "60 s, perfect"}
_MADE_WITH = (
    ("distance", "{distance}"),
    ("preview", "{preview}"),
)
_ROAD = (
    ("headway, mean / median:", "{mean_headway_s:.2f} / {headway_s:.2f} s"),
    ("vehicles/(h lane):", "{vehicles_h:.0f}"),
)
ROAD_COLUMNS = (*_MADE_WITH, *_ROAD)
"""Distance, preview, and the road taken, in every table."""
COLUMNS = (
    *_MADE_WITH,
    (
        "energy saved, equal ends (as driven):",
        "{production_energy:.1f} % ({production_energy_as_driven:.1f})",
    ),
    (
        "ageing saved, median of cells (range):",
        "{production_cells:.1f} % ({production_cells_lowest:.1f} to {production_cells_highest:.1f})",
    ),
    ("by the paper's law:", "{production_ageing:.1f} %"),
    *_ROAD,
    ("below s_min, longest, deepest:", "{below_s:.0f} s, {longest_s:.0f} s, {deepest_m:.1f} m"),
    ("against `eco_acc`, energy / cells:", "{eco_acc_energy:.1f} / {eco_acc_cells:.1f} %"),
)
"""Headings and formats of every table of savings, after the columns of trip and control."""
RULE_COLUMN = (
    "against `rule_preview`, energy / cells:",
    "{rule_preview_energy:.1f} / {rule_preview_cells:.1f} %",
)
"""What an optimisation saves beyond a formula that has the same preview."""


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


def saved(
    own: Sequence[RunMetrics], base: Sequence[RunMetrics], parameters: ModelParameters
) -> dict[str, float]:
    """Return what trips save against others, in percent, each pair brought to one end.

    Args:
        own: the trips.
        base: those with which they are compared, in the same order.
        parameters: of the vehicle.

    Returns:
        ``energy`` of the battery per distance and ``ageing``, capacity lost by both cells by the paper's law,
        NaN where a pack cannot be cooled to a common end;
        ``energy_as_driven``; ``cells``, ``cells_lowest`` and ``cells_highest``: median and range of the
        ageing by the laws of measured cells, as driven and charged again.
    """
    driven_m = [math.fsum(run.distance_m for run in runs) for runs in (own, base)]
    used_j = [math.fsum(run.battery_energy_j for run in runs) for runs in (own, base)]
    as_driven = {
        "energy_as_driven": saved_percent(*(j / m for j, m in zip(used_j, driven_m, strict=True))),
        **_of_cells(own, base),
    }
    ends = [at_equal_end(*pair, parameters) for pair in zip(own, base, strict=True)]
    pairs = [end for end in ends if end is not None]
    if len(pairs) < len(ends):
        return {"ageing": math.nan, "energy": math.nan, **as_driven}
    lost, used_j = (
        [math.fsum(getattr(pair[side], name) for pair in pairs) for side in (0, 1)]
        for name in ("capacity_loss", "energy_j")
    )
    consumed = [energy_j / length_m for energy_j, length_m in zip(used_j, driven_m, strict=True)]
    return {
        "ageing": saved_percent(*lost),
        "energy": saved_percent(*consumed),
        **as_driven,
    }


def _of_cells(own: Sequence[RunMetrics], base: Sequence[RunMetrics]) -> dict[str, float]:
    """Return median and range of what the measured cells save over all trips."""
    names = [name for name in base[0].cell_losses if all(name in run.cell_losses for run in own)]
    percents = [
        saved_percent(*(math.fsum(run.cell_losses[name] for run in runs) for runs in (own, base)))
        for name in names
    ] or [math.nan]
    return {
        "cells": float(np.median(percents)),
        "cells_lowest": min(percents),
        "cells_highest": max(percents),
    }


def kept(own: Sequence[RunMetrics]) -> dict[str, float]:
    """Return seconds below s_min, the longest stretch of these, and the deepest row, over some trips."""
    following = [run.following for run in own]
    return {
        "below_s": math.fsum(each.below_s for each in following),
        "longest_s": max(each.longest_below_s for each in following),
        "deepest_m": max(0.0, *(-each.smallest_margin_m for each in following)),
    }


def savings(
    own: Sequence[RunMetrics],
    bases: Mapping[str, Sequence[RunMetrics]],
    parameters: ModelParameters,
) -> dict[str, float]:
    """Return the savings against some bases, by the name of the base and of the saving, and `kept`."""
    return kept(own) | {
        f"{name}_{kind}": percent
        for name, base in bases.items()
        for kind, percent in saved(own, base, parameters).items()
    }

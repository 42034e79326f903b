"""Why a run saves against another one: its parts, and what preview and distance make of them.

Two more drives of the closed loop stand between the other run and this one: this strategy without a preview
and with no larger gap than the other had, then the same with the preview. Each is divided into the parts of
`iptm_core.metrics.saving_parts`, so that rows and columns of the table add up to the saving with equal ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from iptm_core.errors import ScenarioError, StateError
from iptm_core.metrics import Saving
from iptm_core.metrics.saving_parts import Part, aging_parts, energy_parts
from iptm_core.parameters.loading import parse_overrides
from iptm_core.settings import PreviewMode

if TYPE_CHECKING:
    from iptm.run import Run
    from iptm.trip import Trip

LEAST_ROOM_M = 20.0
"""Smallest upper limit of the gap that the parameters allow."""
AGING, ENERGY = "ageing, paper's law", "energy"
CONTROL, FORESIGHT, DISTANCE, SAVED = "without preview", "foresight", "distance", "saved"


@dataclass(frozen=True)
class Explanation:
    """Where a saving comes from.

    Attributes:
        table: percentage points of the other run's figures. Rows are the parts of energy and ageing, columns
            what the strategy saves without a preview at the distance of the other run, what foresight and
            distance add, and their sum.
        saving: against the other run.
    """

    table: pd.DataFrame
    saving: Saving

    @property
    def sentence(self) -> str:
        """The saving, and its parts and causes in points."""
        lines = "; ".join(f"{label}: {text}" for label, text in self.saving.lines[:3])
        kinds = []
        for kind in (ENERGY, AGING):
            points = self.table.loc[kind]
            parts = ", ".join(f"{value:+.1f} {part}" for part, value in points[SAVED].items())
            causes = points[[FORESIGHT, DISTANCE]].sum()
            added = ", ".join(f"{value:+.1f} {cause}" for cause, value in causes.items())
            kinds.append(f"{kind} in points: {parts}; of it {added}")
        return f"{lines}. {'. '.join(kinds)}."


def parts(run: Run, other: Run) -> pd.Series:
    """Return what a saving is made of, in points, by kind and part; NaN where current is not known."""
    found = run.saving(other)
    energy = energy_parts(run.metrics, other.metrics, found)
    try:
        aging = aging_parts(run.trajectory, other.trajectory, run.parameters, found)
    except StateError:
        aging = dict.fromkeys(
            (Part.THROUGHPUT, Part.C_RATE, Part.TEMPERATURE, Part.INTERACTION, Part.ENDING),
            math.nan,
        )
    rows = {(ENERGY, str(part)): value for part, value in energy.items()}
    rows |= {(AGING, str(part)): value for part, value in aging.items()}
    return pd.Series(rows, dtype=float)


def explain(run: Run, other: Run) -> Explanation:
    """Explain what a run saved against another one of the same trip; drives the trip twice more.

    Raises:
        ScenarioError: the trip of the run is not known, has faults, or the runs differ in vehicle or length.
    """
    trip = _explainable(run, other)
    room_m = math.ceil(float(np.nanmax(other.trajectory.gap_m)))
    near = trip.changed(controller_overrides=_with_room(trip, room_m))
    blind = near.changed(preview_mode=str(PreviewMode.NONE))
    steps = [parts(each, other) for each in (_drive(blind), _drive(near), run)]
    table = {
        CONTROL: steps[0],
        FORESIGHT: steps[1] - steps[0],
        DISTANCE: steps[2] - steps[1],
        SAVED: steps[2],
    }
    return Explanation(pd.DataFrame(table), run.saving(other))


def _explainable(run: Run, other: Run) -> Trip:
    if run.trip is None or run.trip.conditions.faults:
        raise ScenarioError(
            "explain: the trip is not known or has faults; allowed: a run of simulate"
        )
    # The gap that a controller keeps is no part of the vehicle.
    if run.parameters != replace(other.parameters, gap=run.parameters.gap):
        raise ScenarioError("explain: the vehicles differ; allowed: runs of the same vehicle")
    rows = len(run.trajectory), len(other.trajectory)
    if rows[0] != rows[1] or not np.isfinite(other.trajectory.gap_m).all():
        raise ScenarioError(
            f"explain: the runs have {rows[0]} and {rows[1]} rows; "
            "allowed: whole runs of the same trip behind a leader"
        )
    return run.trip


def _with_room(trip: Trip, room_m: float) -> dict[str, float]:
    own = parse_overrides(trip.controller.controller_overrides)
    gap = trip.controller_parameters.gap
    limit_m = min(max(room_m, gap.initial_gap_m, LEAST_ROOM_M), gap.max_gap_m)
    return {**own, "gap.max_gap_m": limit_m}


def _drive(trip: Trip) -> Run:
    from iptm.driving import drive_in_memory  # noqa: PLC0415  it imports this package

    return drive_in_memory(trip)

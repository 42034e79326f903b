"""Why a run saves against another one: its parts, and what each difference of the two runs makes of them.

What differs is switched one at a time, from the other run to this one: the control of the motion, the
control of the cooling, the preview, and the distance. So drives of the closed loop stand between both
runs: with this motion and the other's cooling, then with this cooling, both with the preview of the other
run and with no larger gap than it had, then with this preview. A difference that does not exist is not
driven, and its column is 0. Each drive is divided into the parts of `iptm_core.metrics.saving_parts`, so
that rows and columns of the table add up to the saving.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from iptm_controller.measurements import Measurements
from iptm_controller.strategy import STRATEGIES, DrivingRules
from iptm_core.declaration import parameter_specs, plain
from iptm_core.errors import ScenarioError, StateError
from iptm_core.metrics.saving import Saving
from iptm_core.metrics.saving_parts import Part, aging_parts, energy_parts
from iptm_core.parameters.loading import parse_overrides
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import Command

if TYPE_CHECKING:
    from iptm.closed_loop import TickController
    from iptm.run import Run
    from iptm.trip import Trip

LEAST_ROOM_M = 20.0
"""Smallest upper limit of the gap that the parameters allow."""
AGING, ENERGY = "ageing, paper's law", "energy"
MOTION, COOLING, PREVIEW, DISTANCE, SAVED = "motion", "cooling", "preview", "distance", "saved"
CAUSES = (MOTION, COOLING, PREVIEW, DISTANCE)
_OF_PREVIEW = tuple(spec.name for spec in parameter_specs(PreviewSettings))


@dataclass(frozen=True)
class Explanation:
    """Where a saving comes from.

    Attributes:
        table: percentage points of the other run's figures. Rows are the parts of energy and ageing, columns
            what the control of the motion and of the cooling save at preview and distance of the other run,
            what preview and distance add, and their sum.
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
            causes = points[[*CAUSES]].sum()
            added = ", ".join(f"{value:+.1f} {cause}" for cause, value in causes.items())
            kinds.append(f"{kind} in points: {parts}; by cause {added}")
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
    """Explain what a run saved against another one of the same trip; drives it up to three times more.

    Raises:
        ScenarioError: the trip of a run is not known, has faults, or the runs differ in vehicle or length.
    """
    trip, base = _explainable(run, other)
    near = _near(run, other, trip)
    foreseen = _with_preview(trip if near is run else _trip_of(near), base)
    steps = [run, near, near if foreseen is None else _drive(foreseen)]
    same = steps[-1]
    if _control(trip) != _control(base):
        steps.append(_cooled_as(base, _trip_of(same)))
    else:
        steps.append(same)
    points = [parts(each, other) for each in steps]
    causes = {
        MOTION: points[3],
        COOLING: points[2] - points[3],
        PREVIEW: points[1] - points[2],
        DISTANCE: points[0] - points[1],
    }
    return Explanation(pd.DataFrame({**causes, SAVED: points[0]}), run.saving(other))


def _near(run: Run, other: Run, trip: Trip) -> Run:
    """Return the run with no larger gap than the other one had; itself where that binds nothing."""
    if trip.controller == _trip_of(other).controller and run.parameters == other.parameters:
        return run  # they were given the same room
    largest_m = [float(np.nanmax(each.trajectory.gap_m)) for each in (run, other)]
    if largest_m[0] <= largest_m[1]:
        return run
    return _drive(trip.changed(controller_overrides=_with_room(trip, math.ceil(largest_m[1]))))


def _with_preview(trip: Trip, base: Trip) -> Trip | None:
    """Return a trip with the preview of another one; None where it has that."""
    wanted = {name: getattr(base.preview, name) for name in _OF_PREVIEW}
    if STRATEGIES[base.controller.strategy].is_rule_based and not _foresees(base):
        wanted["preview_mode"] = PreviewMode.NONE
    if not _foresees(trip):
        return None
    if wanted["preview_mode"] is PreviewMode.NONE is trip.preview.preview_mode:
        return None
    if all(getattr(trip.preview, name) == value for name, value in wanted.items()):
        return None
    return trip.changed(**{name: plain(value) for name, value in wanted.items()})


def _foresees(trip: Trip) -> bool:
    """Return whether the strategy of a trip uses a preview."""
    strategy = STRATEGIES[trip.controller.strategy]
    return not strategy.is_rule_based or strategy.rules == DrivingRules.RULE_PREVIEW


def _control(trip: Trip) -> object:
    """Return what decides motion and cooling: strategy, weights and horizon."""
    return replace(trip.controller, controller_overrides="")


class _Hybrid:
    """Drives as one controller and cools as another one."""

    def __init__(self, drives: TickController, cools: TickController) -> None:
        self._drives, self._cools = drives, cools

    def decide(self, measured: Measurements) -> Command:
        driven, cooled = self._drives.decide(measured).command, self._cools.decide(measured).command
        return Command(driven.acceleration_m_s2, cooled.compressor_power_w)


def _cooled_as(base: Trip, trip: Trip) -> Run:
    """Drive a trip with the cooling of another one."""
    from iptm.driving import controller_for, drive_in_memory  # noqa: PLC0415  it imports this package

    cools = replace(trip, controller=base.controller)
    return drive_in_memory(trip, controller=_Hybrid(controller_for(trip), controller_for(cools)))


def _trip_of(run: Run) -> Trip:
    if run.trip is None:
        raise AssertionError("what was driven has a trip")
    return run.trip


def _explainable(run: Run, other: Run) -> tuple[Trip, Trip]:
    if run.trip is None or other.trip is None or run.trip.conditions.faults:
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
    return run.trip, other.trip


def _with_room(trip: Trip, room_m: float) -> dict[str, float]:
    own = parse_overrides(trip.controller.controller_overrides)
    gap = trip.controller_parameters.gap
    limit_m = min(max(room_m, gap.initial_gap_m, LEAST_ROOM_M), gap.max_gap_m)
    return {**own, "gap.max_gap_m": limit_m}


def _drive(trip: Trip) -> Run:
    from iptm.driving import drive_in_memory  # noqa: PLC0415  it imports this package

    return drive_in_memory(trip)

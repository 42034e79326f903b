"""Why a run saves against another one: drives that switch one thing off, in a table that adds up.

From the other run to this one it takes five steps. The first three change the motion of the vehicle while the
compressor does in trip time what it did in the other run; the others change the cooling:

    smoothness   the motion of this strategy without a preview, with no larger gap than the other had
    foresight    with the preview
    distance     with the gap that it has
    temperature  with the temperatures of the pack that it has, at the power of before
    cooling      with the power of its compressor
    end state    both packs brought to the same temperature, motion given back

Motions come from drives of the closed loop, all else from drives of the plant with a given motion and
compressor power. The ageing law at every row separates temperature from cooling. What the drives do not
reproduce of the two runs is the remainder, so that the parts add up to the saving with equal ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.metrics import Judgement, RunMetrics, Saving, compute_metrics, judge_saving
from iptm_core.metrics.saving import saved_text
from iptm_core.parameters.loading import parse_overrides
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.settings import PreviewMode
from iptm_core.state import Command, FloatArray
from iptm_core.trajectory import Trajectory

LEAST_ROOM_M = 20.0
"""Smallest upper limit of the gap that the parameters allow."""

if TYPE_CHECKING:
    from iptm.run import Run
    from iptm.trip import Trip


class Cause(TextEnum):
    """Where a part of a saving comes from, in the order of the steps."""

    SMOOTHNESS = "smoothness"
    FORESIGHT = "foresight"
    DISTANCE = "distance"
    TEMPERATURE = "temperature of the pack"
    COOLING = "cooling power"
    END_STATE = "end state"
    REMAINDER = "remainder"


MOTION = (Cause.SMOOTHNESS, Cause.FORESIGHT, Cause.DISTANCE)
THERMAL = (Cause.TEMPERATURE, Cause.COOLING, Cause.END_STATE)


@dataclass(frozen=True)
class Explanation:
    """Where a saving comes from.

    Attributes:
        table: percentage points of the other run's figures by cause (rows), for ``aging`` and ``energy``.
        saving: against the other run; its figures with equal ends are the sums of the columns.
    """

    table: pd.DataFrame
    saving: Saving

    @property
    def sentence(self) -> str:
        """The saving of ageing or why none is quoted, and how much the motion and the cooling make."""
        points, aging = self.table["aging"], self.saving.aging
        percent = aging.equal_ends_percent
        saved = f"{saved_text(percent)} of the ageing with equal ends"
        if aging.judgement is not Judgement.JUDGED:
            judgement = str(aging.judgement).capitalize()
            saved = f"{judgement}, {percent:+.1f} points with equal ends"
        motion = ", ".join(f"{points[str(cause)]:+.1f} {cause}" for cause in MOTION)
        cooling = sum(points[str(cause)] for cause in THERMAL)
        return (
            f"{saved}; in points: {motion}, {cooling:+.1f} cooling with what it leaves at the end, "
            f"{points[str(Cause.REMAINDER)]:+.1f} not explained."
        )


def explain(run: Run, other: Run) -> Explanation:
    """Explain what a run saved against another one of the same trip; drives the trip twice more.

    Raises:
        ScenarioError: the trip of the run is not known, has faults, or the runs differ in vehicle or length.
    """
    trip = _explainable(run, other)
    room_m = math.ceil(float(np.nanmax(other.trajectory.gap_m)))
    near = trip.changed(controller_overrides=_with_room(trip, room_m))
    blind = near.changed(preview_mode=str(PreviewMode.NONE))
    motions = (other.trajectory, _drive(blind), _drive(near), run.trajectory)
    cooling_w = other.trajectory.compressor_power_w
    drives = [replayed(run, motion, cooling_w) for motion in motions]
    drives.append(replayed(run, run.trajectory, run.trajectory.compressor_power_w))
    figures = [compute_metrics(drive, run.parameters) for drive in drives]
    found = judge_saving(run.metrics, other.metrics, run.parameters)
    return Explanation(
        pd.DataFrame(
            {
                "aging": _points(
                    [each.degradation for each in figures],
                    _warmth_share(drives[3], drives[4], run.parameters),
                    (found.aging.as_driven_percent, found.aging.equal_ends_percent),
                ),
                "energy": _points(
                    [_per_metre(each) for each in figures],
                    0.0,
                    (found.energy.as_driven_percent, found.energy.equal_ends_percent),
                ),
            }
        ),
        found,
    )


def replayed(run: Run, motion: Trajectory, compressor_power_w: FloatArray) -> Trajectory:
    """Return what the plant of a run does with the speeds of a drive and compressor powers by row.

    Row k of both acts over the interval that ends at t_k, as in a trajectory.
    """
    from iptm.driving import plant_for  # noqa: PLC0415  it imports this package

    if run.trip is None:
        raise AssertionError("a run with a trip is checked for")
    plant = plant_for(run.trip)
    step = plant.observe(plant.initial_state(float(motion.position_m[0])))
    steps = [step]
    for row, duration_s in enumerate(motion.intervals_s.tolist(), start=1):
        wanted_m_s2 = (float(motion.speed_m_s[row]) - step.state.speed_m_s) / duration_s
        command = Command(wanted_m_s2, float(compressor_power_w[row]))
        step = plant.advance(step.state, command, duration_s)
        steps.append(step)
    return Trajectory.from_ticks((each, None) for each in steps)


def _explainable(run: Run, other: Run) -> Trip:
    if run.trip is None or run.trip.conditions.faults:
        raise ScenarioError(
            "explain: the trip is not known or has faults; allowed: a run of simulate"
        )
    if run.parameters != other.parameters:
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


def _drive(trip: Trip) -> Trajectory:
    from iptm.driving import drive_in_memory  # noqa: PLC0415  it imports this package

    return drive_in_memory(trip).trajectory


def _per_metre(metrics: RunMetrics) -> float:
    return metrics.battery_energy_j / metrics.distance_m


def _points(
    figures: list[float], warmth: float, percents: tuple[float, float]
) -> Mapping[str, float]:
    """Return the points of each cause.

    Args:
        figures: of the five drives, from the other run's to this run's.
        warmth: share of the last step that the temperatures have.
        percents: saving as driven and with equal ends.
    """
    steps = -100.0 * np.diff(figures) / figures[0]
    as_driven, equal_ends = percents
    parts = {
        Cause.SMOOTHNESS: steps[0],
        Cause.FORESIGHT: steps[1],
        Cause.DISTANCE: steps[2],
        Cause.TEMPERATURE: warmth * steps[3],
        Cause.COOLING: (1.0 - warmth) * steps[3],
        Cause.END_STATE: equal_ends - as_driven,
        Cause.REMAINDER: as_driven - float(steps.sum()),
    }
    return {cause.value: float(points) for cause, points in parts.items()}


def _warmth_share(before: Trajectory, after: Trajectory, parameters: ModelParameters) -> float:
    """Return the share of the temperatures in the change of the ageing by another cooling."""
    old = _aging(before, before, parameters)
    warmed, new = _aging(before, after, parameters), _aging(after, after, parameters)
    return (warmed - old) / (new - old) if new != old else 0.0


def _aging(powers: Trajectory, cells: Trajectory, parameters: ModelParameters) -> float:
    """Return the ageing at the motion and compressor power of one drive and the cells of another."""

    def middle(column: FloatArray) -> FloatArray:
        return 0.5 * (column[1:] + column[:-1])

    at = at_charge(parameters, middle(powers.state_of_charge))
    pair = CellPair(
        middle(cells.cell_1_temperature_k),
        middle(cells.cell_n_temperature_k),
        middle(cells.cell_1_capacity_loss),
        middle(cells.cell_n_capacity_loss),
    )
    accelerations = np.diff(powers.speed_m_s) / powers.intervals_s
    rates = power_thermal_rates(
        middle(powers.speed_m_s),
        accelerations,
        0.0,
        powers.compressor_power_w[1:],
        pair,
        at,
        reduce_channel(parameters.cooling, parameters.pack),
    )
    total = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
    return float(np.dot(total, powers.intervals_s))

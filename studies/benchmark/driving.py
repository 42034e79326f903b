"""A task driven by an entrant, and judged by the numbers of the task."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from studies.benchmark.entrants import entrant_of
from studies.benchmark.foreign import place_of, recorded
from studies.benchmark.judge import ROWS, Found, judged

import iptm
from iptm.closed_loop import TickController, decided
from iptm.driving import controller_for, trip_in_ticks
from iptm.own_parts import OwnController
from iptm_controller.arrival import ArrivalCost
from iptm_controller.decision import Decision
from iptm_core.aging_laws.cells import NCA, NMC811_SI
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.state import FloatArray

LAWS = {cell.law.name: cell.law for cell in (NCA, NMC811_SI)}


@dataclass(frozen=True, eq=False)
class Driven:
    """Rows of a trip by name, and how long decisions took (s): median and 99th percentile."""

    rows: Mapping[str, FloatArray]
    median_s: float
    late_s: float


class _Timed:
    def __init__(self, inner: TickController) -> None:
        self.options, self._inner, self.times_s = inner.options, inner, list[float]()

    def decide(self, measured: iptm.Measurements) -> Decision:
        began_s = time.perf_counter()
        decision = self._inner.decide(measured)
        self.times_s.append(time.perf_counter() - began_s)
        return decision


def drive(trip: iptm.Trip, entrant: str, files: Sequence[Path] = ()) -> Driven | None:
    """Drive a task with an entrant; None for a task of which a node has no bag.

    Args:
        trip: the task.
        entrant: name, or file of a foreign one.
        files: of the latter; a kept run counts as long as they are the same.
    """
    del files
    who = entrant_of(entrant)
    if who.source and who.law is None:
        columns = recorded(place_of(who.source)[0], trip)
        unknown_s = math.nan
        return None if columns is None else Driven(rows_of(columns), unknown_s, unknown_s)
    trip = merged(trip, who.settings).checked()
    own = who.controller(trip)
    limits, tick_s = trip.parameters.limits, trip.conditions.period_s
    timed = _Timed(controller_for(trip) if own is None else OwnController(own, limits, tick_s))
    run = decided(trip_in_ticks(trip), timed)
    return Driven(
        rows_of(run.trajectory.to_arrays()),
        float(np.median(timed.times_s)),
        float(np.quantile(timed.times_s, 0.99)),
    )


def rows_of(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns that are judged."""
    return {name: columns[name] for name in ROWS}


def merged(trip: iptm.Trip, settings: Mapping[str, Any]) -> iptm.Trip:
    """Return a task with the settings of a strategy; the climate of the task stays."""
    text = trip.vehicle.overrides
    added = ", ".join(f"{key}={value}" for key, value in settings.get("overrides", {}).items())
    return trip.changed(**{**settings, "overrides": ", ".join(filter(None, (text, added)))})


def judge(driven: Driven, trip: iptm.Trip) -> Found:
    """Judge a trip by the numbers of its task."""
    cost = ArrivalCost.parse(trip.controller.arrival_cost_eur)
    arrival = None if cost is None else (np.array(cost.celsius), np.array(cost.eur))
    return judged(driven.rows, trip.parameters, AgingSettings(), LAWS, arrival)

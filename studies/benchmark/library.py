"""What the judge finds, by the figures of the library instead: the second judge of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from studies.benchmark.driving import LAWS, Driven, judge, rows_of
from studies.benchmark.judge import Found, judged

import iptm
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saving import cool_down
from iptm_core.metrics.trip_cost import trip_cost
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray


def both_judges(run: iptm.Run, trip: iptm.Trip) -> tuple[Found, Found]:
    """Return what the judge finds in the rows of a run, and what the library finds in the run."""
    rows = rows_of(run.trajectory.to_arrays())
    found = judge(Driven(rows, 0.0, 0.0), trip)
    return found, by_library(found, rows, run)


def by_library(found: Found, rows: Mapping[str, FloatArray], run: iptm.Run) -> Found:
    """Return it with the costs of the library; of the paper's law, which has no price there, the judge's."""
    use, p = AgingSettings(), run.parameters
    costs = [trip_cost(run.trajectory, run.metrics, p, use, law) for law in ("nca", "nmc811_si")]
    # What cells lose while they are cooled down is the judge's: the library has no such loss.
    at_rest = judged(ended_at(rows, p.limits.min_temperature_k), p, use, LAWS)
    aging = [each.driving_eur for each in costs] + [at_rest.aging_eur["paper"]]
    after = [found.aging_eur[name] - at_rest.aging_eur[name] for name in found.aging_eur]
    energy_eur = costs[0].energy_eur + use.electricity_eur_kwh * ending_kwh(run.metrics, p)
    eur = [energy_eur + one + more for one, more in zip(aging, after, strict=True)]
    return replace(found, eur=float(np.median(eur)))


def ending_kwh(metrics: RunMetrics, parameters: ModelParameters) -> float:
    """Return the energy of cooling the pack down to its lower limit in kWh per 100 km."""
    cooling = cool_down(metrics, parameters.limits.min_temperature_k, parameters)
    return math.inf if cooling is None else cooling[0] / 3.6e6 / metrics.distance_m * 1e5


def ended_at(rows: Mapping[str, FloatArray], end_k: float) -> dict[str, FloatArray]:
    """Return rows with another temperature of both cells at the end."""
    cells = ("cell_1_temperature_k", "cell_n_temperature_k")
    return {**rows, **{name: np.append(rows[name][:-1], end_k) for name in cells}}

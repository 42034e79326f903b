"""A trip as a function of the temperature of the pack at its start, of which years of use are composed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from iptm_core.parameters import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

START_C = (22.0, 28.0, 34.0, 40.0)
"""Temperatures at which the pack begins a trip."""
SAMPLE_S = 300.0
_OVER_START = ("temperature_k", "c_rate_1_h", "drawn", "end_k", "compressor_j")
"""What of a trip depends on the temperature at its start."""


@dataclass(frozen=True)
class TripMap:
    """A trip under one control as a function of the temperature of the pack at its start.

    Samples are means of intervals of `SAMPLE_S`, the last of which may be shorter.

    Attributes:
        start_k: temperatures at the start, increasing, shape (m,).
        temperature_k: mean of the two cells, shape (m, n).
        c_rate_1_h: mean magnitude of battery power over nominal energy, shape (m, n).
        drawn: share of the nominal energy drawn since the start, shape (m, n).
        end_k: temperature at the end, shape (m,).
        compressor_j: energy of the compressor, shape (m,).
        duration_s: length.
        distance_m: length, mean over the starts.
    """

    start_k: FloatArray
    temperature_k: FloatArray
    c_rate_1_h: FloatArray
    drawn: FloatArray
    end_k: FloatArray
    compressor_j: FloatArray
    duration_s: float
    distance_m: float

    def from_start(self, start_k: float) -> TripMap:
        """Return the trip from one temperature.

        Beyond those driven, the pack changes its temperature by as much as from the nearest one.
        """
        inside_k = float(np.clip(start_k, self.start_k[0], self.start_k[-1]))
        above = int(np.clip(np.searchsorted(self.start_k, inside_k), 1, self.start_k.size - 1))
        low, high = self.start_k[above - 1 : above + 1]
        share = (inside_k - low) / (high - low)

        def between(values: FloatArray) -> FloatArray:
            mixed: FloatArray = (1.0 - share) * values[above - 1] + share * values[above]
            return np.asarray(mixed)[np.newaxis]

        found: dict[str, Any] = {name: between(getattr(self, name)) for name in _OVER_START}
        shift_k = start_k - inside_k
        found["temperature_k"] = found["temperature_k"] + shift_k
        found["end_k"] = found["end_k"] + shift_k
        return replace(self, start_k=np.array([start_k]), **found)

    def towards(self, other: TripMap, share: float) -> TripMap:
        """Return the trip a share of the way to another one of the same cycle, from the same starts."""
        mixed: dict[str, Any] = {
            name: (1.0 - share) * getattr(self, name) + share * getattr(other, name)
            for name in (*_OVER_START, "distance_m")
        }
        return replace(self, **mixed)

    @cached_property
    def durations_s(self) -> FloatArray:
        """Lengths of the samples, shape (n,)."""
        lengths = np.full(self.drawn.shape[1], SAMPLE_S)
        lengths[-1] = self.duration_s - SAMPLE_S * (lengths.size - 1)
        return lengths


def nominal_energy_j(parameters: ModelParameters) -> float:
    """Return the energy of the full pack at its open-circuit voltage."""
    cell, pack = parameters.cell, parameters.pack
    return pack.open_circuit_voltage_v * cell.nominal_capacity_ah * pack.parallel * 3600.0


def heat_capacity_j_k(parameters: ModelParameters) -> float:
    """Return the heat capacity of all cells of the pack."""
    pack = parameters.pack
    cells = pack.modules * pack.series_per_module * pack.parallel
    return cells * parameters.cell.heat_capacity_j_k


def mean_cell_k(run: Trajectory) -> FloatArray:
    """Return the mean temperature of the two cells, shape (n,)."""
    return 0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k)


def compressor_j(run: Trajectory) -> float:
    """Return the energy of the compressor."""
    return float(np.sum(run.compressor_power_w[1:] * np.diff(run.time_s)))


def trip_map(runs: Sequence[Trajectory], energy_j: float) -> TripMap:
    """Return the map of a trip driven from several temperatures, lowest first.

    Args:
        runs: the trips.
        energy_j: nominal energy of the pack.
    """
    rows = [_sampled(run, energy_j) for run in runs]
    temperature_k, c_rate_1_h, drawn = (np.array(column) for column in zip(*rows, strict=True))
    mean_k = [mean_cell_k(run) for run in runs]
    return TripMap(
        np.array([kelvin[0] for kelvin in mean_k]),
        temperature_k,
        c_rate_1_h,
        drawn,
        np.array([kelvin[-1] for kelvin in mean_k]),
        np.array([compressor_j(run) for run in runs]),
        float(runs[0].time_s[-1] - runs[0].time_s[0]),
        float(np.mean([run.position_m[-1] - run.position_m[0] for run in runs])),
    )


def _sampled(run: Trajectory, energy_j: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    step_s = np.diff(run.time_s)
    sample = ((run.time_s[1:] - run.time_s[0] - 0.5 * step_s) // SAMPLE_S).astype(int)
    length_s = np.bincount(sample, step_s)
    kelvin = mean_cell_k(run)[1:]
    power_w = run.battery_power_w[1:]
    drawn = np.cumsum(np.bincount(sample, power_w * step_s)) / energy_j
    c_rate = 3600.0 * np.bincount(sample, np.abs(power_w) * step_s) / length_s / energy_j
    return np.bincount(sample, kelvin * step_s) / length_s, c_rate, drawn

"""Temperatures and ageing of the cells of a full coolant channel, and the error of the two-cell reduction.

All temperatures of a trip are millions of numbers; a stored run keeps the evaluated part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from iptm_core.state import FloatArray, FullChannelState, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep

PROFILES = 5
"""Instants at which all temperatures are kept, evenly over the trip, and the instant of the largest error."""


class ChannelRecord(TypedDict):
    """Every cell of a channel over a trip, as plain values; lists have one entry per cell, from the inlet on.

    A hottest cell is its number ``cell`` from 1 at the inlet, ``time_s``, ``temperature_k``, and ``excess_k``
    over the warmer one of cells 1 and N_c. An error is its root mean square ``rms_k`` and largest magnitude
    ``max_k`` over a trip.

    Attributes:
        hottest_shares: parts of the trip for which each cell is the hottest.
        peak: the hottest cell of the trip.
        largest_excess: the hottest cell when it exceeds cells 1 and N_c by most.
        line_rms_k: error of a straight line between cells 1 and N_c by cell, root of the mean square.
        line_max_k: its largest magnitude by cell.
        line: that error over all cells.
        two_cell_1: error of cell 1 of the two-cell model under the same commands.
        two_cell_n: error of its cell N_c.
        two_cell_losses: losses of its cells 1 and N_c over the trip.
        profiles_k: all cell temperatures at some instants, ``profile_times_s``.
    """

    mean_temperatures_k: list[float]
    max_temperatures_k: list[float]
    capacity_losses: list[float]
    hottest_shares: list[float]
    peak: dict[str, float]
    largest_excess: dict[str, float]
    line_rms_k: list[float]
    line_max_k: list[float]
    line: dict[str, float]
    two_cell_1: dict[str, float]
    two_cell_n: dict[str, float]
    two_cell_losses: list[float]
    profile_times_s: list[float]
    profiles_k: list[list[float]]


def channel_record(steps: Sequence[PlantStep], two_cells: Plant, tick_s: float) -> ChannelRecord:
    """Sum up a trip of a plant with a full channel.

    Args:
        steps: what the plant knew at every instant of the trip.
        two_cells: the same vehicle with two cells; it is driven with the same commands.
        tick_s: time between two instants.
    """
    times = np.array([step.state.time_s for step in steps])
    states = [step.state for step in steps]
    cells = [state.cells for state in states if isinstance(state, FullChannelState)]
    temperatures = np.array([entry.temperatures_k for entry in cells])
    along = np.linspace(0.0, 1.0, temperatures.shape[1])
    line = temperatures[:, :1] + (temperatures[:, -1:] - temperatures[:, :1]) * along
    errors = line - temperatures
    hottest = temperatures.argmax(axis=1)
    shares = np.bincount(hottest, minlength=along.size) / hottest.size
    excess = temperatures.max(axis=1) - temperatures[:, (0, -1)].max(axis=1)

    def hottest_at(row: int) -> dict[str, float]:
        cell = int(hottest[row])
        return {
            "cell": cell + 1,
            "time_s": float(times[row]),
            "temperature_k": float(temperatures[row, cell]),
            "excess_k": float(excess[row]),
        }

    reduced = _driven(two_cells, steps, tick_s)
    error_1 = [state.cell_1_temperature_k for state in reduced] - temperatures[:, 0]
    error_n = [state.cell_n_temperature_k for state in reduced] - temperatures[:, -1]
    evenly = np.linspace(0.0, times.size - 1.0, PROFILES + 1)[1:]
    rows = sorted({*evenly.astype(int).tolist(), int(np.abs(errors).max(axis=1).argmax())})
    return ChannelRecord(
        mean_temperatures_k=temperatures.mean(axis=0).tolist(),
        max_temperatures_k=temperatures.max(axis=0).tolist(),
        capacity_losses=(cells[-1].capacity_losses - cells[0].capacity_losses).tolist(),
        hottest_shares=shares.tolist(),
        peak=hottest_at(int(temperatures.max(axis=1).argmax())),
        largest_excess=hottest_at(int(excess.argmax())),
        line_rms_k=np.sqrt(np.mean(errors**2, axis=0)).tolist(),
        line_max_k=np.abs(errors).max(axis=0).tolist(),
        line=_error(errors),
        two_cell_1=_error(error_1),
        two_cell_n=_error(error_n),
        two_cell_losses=[
            reduced[-1].cell_1_capacity_loss - reduced[0].cell_1_capacity_loss,
            reduced[-1].cell_n_capacity_loss - reduced[0].cell_n_capacity_loss,
        ],
        profile_times_s=times[rows].tolist(),
        profiles_k=temperatures[rows].tolist(),
    )


def _error(errors_k: FloatArray) -> dict[str, float]:
    return {
        "rms_k": float(np.sqrt(np.mean(errors_k**2))),
        "max_k": float(np.max(np.abs(errors_k))),
    }


def _driven(plant: Plant, steps: Sequence[PlantStep], tick_s: float) -> list[VehicleState]:
    """States of a plant under the commands of a trip."""
    states = [plant.initial_state()]
    for step in steps[1:]:
        states.append(plant.advance(states[-1], step.report.requested, tick_s).state)
    return states

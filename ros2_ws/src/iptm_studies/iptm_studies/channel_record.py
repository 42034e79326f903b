"""Temperatures and ageing of the cells of a full coolant channel, and the error of the two-cell reduction.

All temperatures of a trip are millions of numbers; a stored run keeps the evaluated part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from iptm_core.state import FloatArray, FullChannelState, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep

PROFILES = 5
"""Instants at which all temperatures are kept, evenly over the trip, plus that of the largest error."""

PerCell = tuple[float, ...]


@dataclass(frozen=True)
class CellError:
    """Root mean square and largest magnitude of the error of a cell's temperature over a trip."""

    rms_k: float
    max_k: float

    @classmethod
    def of(cls, errors_k: FloatArray) -> CellError:
        """Return the error of a whole series."""
        return cls(float(np.sqrt(np.mean(errors_k**2))), float(np.max(np.abs(errors_k))))


@dataclass(frozen=True)
class HottestCell:
    """The cell (from 1 at the inlet) that is the hottest one at an instant.

    It is warmer than the warmer one of cells 1 and N_c by ``excess_k``.
    """

    cell: int
    time_s: float
    temperature_k: float
    excess_k: float


@dataclass(frozen=True)
class ChannelRecord:
    """Every cell of a channel over a trip; tuples have one entry per cell, from the inlet on.

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

    mean_temperatures_k: PerCell
    max_temperatures_k: PerCell
    capacity_losses: PerCell
    hottest_shares: PerCell
    peak: HottestCell
    largest_excess: HottestCell
    line_rms_k: PerCell
    line_max_k: PerCell
    line: CellError
    two_cell_1: CellError
    two_cell_n: CellError
    two_cell_losses: tuple[float, float]
    profile_times_s: tuple[float, ...]
    profiles_k: tuple[PerCell, ...]

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ChannelRecord:
        """Rebuild a record from plain values, the inverse of ``dataclasses.asdict`` through JSON."""
        parts = {"HottestCell": HottestCell, "CellError": CellError}
        arguments: dict[str, Any] = {}
        for entry in fields(cls):
            value = content[entry.name]
            part = parts.get(str(entry.type))
            arguments[entry.name] = _as_tuple(value) if part is None else part(**value)
        return cls(**arguments)


def _as_tuple(values: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(_as_tuple(value) if isinstance(value, list) else value for value in values)


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

    def hottest_at(row: int) -> HottestCell:
        cell = int(hottest[row])
        return HottestCell(
            cell + 1, float(times[row]), float(temperatures[row, cell]), float(excess[row])
        )

    reduced = _driven(two_cells, steps, tick_s)
    error_1 = [state.cell_1_temperature_k for state in reduced] - temperatures[:, 0]
    error_n = [state.cell_n_temperature_k for state in reduced] - temperatures[:, -1]
    evenly = np.linspace(0.0, times.size - 1.0, PROFILES + 1)[1:]
    rows = sorted({*evenly.astype(int).tolist(), int(np.abs(errors).max(axis=1).argmax())})
    return ChannelRecord(
        mean_temperatures_k=_per_cell(temperatures.mean(axis=0)),
        max_temperatures_k=_per_cell(temperatures.max(axis=0)),
        capacity_losses=_per_cell(cells[-1].capacity_losses - cells[0].capacity_losses),
        hottest_shares=_per_cell(shares),
        peak=hottest_at(int(temperatures.max(axis=1).argmax())),
        largest_excess=hottest_at(int(excess.argmax())),
        line_rms_k=_per_cell(np.sqrt(np.mean(errors**2, axis=0))),
        line_max_k=_per_cell(np.abs(errors).max(axis=0)),
        line=CellError.of(errors),
        two_cell_1=CellError.of(error_1),
        two_cell_n=CellError.of(error_n),
        two_cell_losses=(
            reduced[-1].cell_1_capacity_loss - reduced[0].cell_1_capacity_loss,
            reduced[-1].cell_n_capacity_loss - reduced[0].cell_n_capacity_loss,
        ),
        profile_times_s=tuple(times[rows].tolist()),
        profiles_k=tuple(_per_cell(temperatures[row]) for row in rows),
    )


def _per_cell(values: FloatArray) -> PerCell:
    return tuple(values.tolist())


def _driven(plant: Plant, steps: Sequence[PlantStep], tick_s: float) -> list[VehicleState]:
    """States of a plant under the commands of a trip."""
    states = [plant.initial_state()]
    for step in steps[1:]:
        states.append(plant.advance(states[-1], step.report.requested, tick_s).state)
    return states

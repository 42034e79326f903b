"""Tables of columns, and a finished run: one row per tick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iptm_core.errors import StateError
from iptm_core.state import (
    FloatArray,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    VehicleState,
)

AnyColumns = TypeVar("AnyColumns", bound="Columns")
_ALWAYS_KNOWN = frozenset({"time_s", "position_m", "speed_m_s"})


@dataclass(frozen=True, eq=False)
class Columns:
    """Base of tables: each field is a column of shape (n,), a read-only copy of the argument.

    Raises:
        StateError: columns of different length, or missing or unknown ones.
    """

    table: ClassVar[str] = "table"
    """Name of the table in messages."""
    types: ClassVar[Mapping[str, type]] = {}
    """Types of the columns other than float."""

    def __post_init__(self) -> None:
        names = self.names()
        rows = np.size(getattr(self, names[0]))
        for name in names:
            kind = self.types.get(name, np.float64)
            values: NDArray[Any] = np.array(getattr(self, name), dtype=kind)
            if values.shape != (rows,):
                raise StateError(
                    f"{self.table}: {name} has shape {values.shape}; allowed: one value per row, ({rows},)"
                )
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        """Number of rows."""
        return int(np.size(getattr(self, self.names()[0])))

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the columns, in their order."""
        return tuple(entry.name for entry in fields(cls))

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the columns by name."""
        return {name: getattr(self, name) for name in self.names()}

    @classmethod
    def from_arrays(cls: type[AnyColumns], columns: Mapping[str, ArrayLike]) -> AnyColumns:  # noqa: PYI019
        """Build a table from columns by name."""
        missing = [name for name in cls.names() if name not in columns]
        unknown = [name for name in columns if name not in cls.names()]
        if missing or unknown:
            raise StateError(
                f"{cls.table}: columns missing {missing}, unknown {unknown}; "
                f"needed are exactly {', '.join(cls.names())}"
            )
        return cls(**{name: np.array(values) for name, values in columns.items()})


@dataclass(frozen=True, eq=False)
class Trajectory(Columns):
    """Everything that happened in a run, as arrays of equal length, shape (n,), read-only.

    Row k holds the state at t_k and what happened over the interval that ended at t_k: the
    actuated commands and the mean powers. Row 0 ends no interval: its powers are zero by
    definition, and its acceleration and compressor power are those the run started from.

    Signs and symbols as in `VehicleState` and `IntervalPowers`. NaN stands for unknown values: the
    leader in any row, any other column throughout, but never time, position and speed.

    Attributes:
        time_s: instants t_k, strictly increasing.
        leader_position_m: rear bumper of the preceding vehicle; NaN where it was not measured.
        leader_speed_m_s: speed of the preceding vehicle; NaN without one.
        service_braking_s: part of the interval in which the safety monitor braked.
        smallest_gap_m: smallest gap known of the interval, its end included; in row 0 the gap; NaN if
            none is known.
        state_of_charge: charge left in the pack as a fraction of its capacity, with the 32 bits of the
            battery message.
        command_source: number of the `CommandSource` of the interval that ended at the row.
    """

    table = "trajectory"
    time_s: FloatArray
    position_m: FloatArray
    speed_m_s: FloatArray
    acceleration_m_s2: FloatArray
    compressor_power_w: FloatArray
    cell_1_temperature_k: FloatArray
    cell_n_temperature_k: FloatArray
    cell_1_capacity_loss: FloatArray
    cell_n_capacity_loss: FloatArray
    coolant_inlet_temperature_k: FloatArray
    coolant_outlet_temperature_k: FloatArray
    traction_power_w: FloatArray
    auxiliary_power_w: FloatArray
    battery_power_w: FloatArray
    chiller_heat_w: FloatArray
    battery_heat_w: FloatArray
    leader_position_m: FloatArray
    leader_speed_m_s: FloatArray
    service_braking_s: FloatArray
    smallest_gap_m: FloatArray
    state_of_charge: FloatArray
    command_source: FloatArray

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self):
            raise StateError("trajectory: 0 rows; allowed: at least one")
        for name, values in self.to_arrays().items():
            unknown = np.isnan(values)
            allowed = name not in _ALWAYS_KNOWN and (name in _OF_LEADER or bool(np.all(unknown)))
            for row in np.flatnonzero(~np.isfinite(values) & ~(unknown & allowed)):
                raise StateError(
                    f"trajectory: {name} is {values[row]} in row {row}; allowed: a finite value"
                )
        for row in np.flatnonzero(np.diff(self.time_s) <= 0.0) + 1:
            raise StateError(
                f"trajectory: time_s is {self.time_s[row]} in row {row} after "
                f"{self.time_s[row - 1]}; allowed: increasing times"
            )

    @classmethod
    def from_stored(cls, columns: Mapping[str, ArrayLike]) -> Trajectory:
        """Build a trajectory from columns of a file; what earlier versions did not store is not known."""
        missing = np.full(np.shape(columns["time_s"]), math.nan)
        return cls.from_arrays({"command_source": missing, **columns})

    @property
    def has_leader(self) -> NDArray[np.bool_]:
        """Whether the leader was measured at an instant, shape (n,)."""
        known: NDArray[np.bool_] = np.isfinite(self.leader_position_m + self.leader_speed_m_s)
        return known

    @property
    def unknown(self) -> dict[str, int]:
        """Rows in which a column is not known, by the names of such columns."""
        counts = {
            name: int(np.count_nonzero(np.isnan(column)))
            for name, column in self.to_arrays().items()
        }
        return {name: count for name, count in counts.items() if count}

    @property
    def gap_m(self) -> FloatArray:
        """Distance from the ego vehicle to the leader at every instant, shape (n,); NaN without a leader."""
        gap: FloatArray = self.leader_position_m - self.position_m
        return gap

    @property
    def closest_m(self) -> FloatArray:
        """Smallest gap that is known of the interval that ends at each row, its end included, shape (n,)."""
        return np.fmin(self.gap_m, self.smallest_gap_m)

    @property
    def intervals_s(self) -> FloatArray:
        """Length of the intervals that end at rows 1 to n - 1, shape (n - 1,)."""
        return np.diff(self.time_s)

    @classmethod
    def from_ticks(cls, ticks: Iterable[tuple[PlantObservation, LeaderState | None]]) -> Trajectory:
        """Build a trajectory from plant and leader, if measured, tick by tick."""
        return cls.from_rows([value for tick in ticks for value in trajectory_row(*tick)])

    @classmethod
    def from_rows(cls, numbers: Sequence[float]) -> Trajectory:
        """Build a trajectory from the numbers of its rows, one `trajectory_row` after the other."""
        table = np.array(numbers, dtype=np.float64).reshape(-1, len(_OBSERVED) + len(_LEADER))
        columns = dict(zip((*_OBSERVED, *_LEADER), np.ascontiguousarray(table.T), strict=True))
        columns["state_of_charge"] = columns["state_of_charge"].astype(np.float32)
        gap_m = columns["leader_position_m"] - columns["position_m"]
        columns["smallest_gap_m"] = np.fmin(gap_m, columns["smallest_gap_m"])
        return cls(**columns)


_OBSERVED = {
    # The compressor power stands in powers and state; the state holds the commanded one.
    **{entry.name: f"powers.{entry.name}" for entry in fields(IntervalPowers)},
    **{entry.name: f"state.{entry.name}" for entry in fields(VehicleState)},
    "coolant_inlet_temperature_k": "coolant_inlet_temperature_k",
    "coolant_outlet_temperature_k": "coolant_outlet_temperature_k",
    "service_braking_s": "safety.service_braking_s",
    "smallest_gap_m": "safety.smallest_gap_m",
    "command_source": "safety.command_source",
}
"""Where the columns of the vehicle are in a `PlantObservation`."""
_LEADER = "leader_position_m", "leader_speed_m_s"
_observed, _motion = attrgetter(*_OBSERVED.values()), attrgetter("position_m", "speed_m_s")
_UNKNOWN = math.nan, math.nan
_OF_LEADER = frozenset((*_LEADER, "smallest_gap_m"))


def trajectory_row(observed: PlantObservation, leader: LeaderState | None) -> tuple[float, ...]:
    """Return the numbers of an instant, with the leader if it was measured."""
    return (*_observed(observed), *(_UNKNOWN if leader is None else _motion(leader)))


TRAJECTORY_COLUMNS = Trajectory.names()
"""Names of the columns of a `Trajectory`."""

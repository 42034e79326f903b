"""The small data types that travel between plant, bridge and controller.

All values are SI: metres along the road, m/s, kelvin, watts, seconds since the start of the trip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import StateError
from iptm_core.frozen import replace

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
FloatArray = NDArray[np.float64]
ROUNDING_S, TOLERANCE_S = 1e-9, 1e-6
"""Instants closer to each other are the same: computed from the same numbers, and stamped by others."""
SPEED_AT_REST_M_S = -0.5
"""Measured speeds from here to 0 mean a vehicle at rest, with an error of the measurement."""
KNOWN_BOUND_M = 1.0
"""Largest bound at which a predicted position of the leader is treated as known: a path that the leader sends
is, an acceleration that is expected to decay is not after two seconds."""


@dataclass(frozen=True)
class VehicleState:
    """The ego vehicle and its pack at one instant (paper: x, with the inputs last actuated).

    Attributes:
        speed_m_s: speed (v), never negative.
        acceleration_m_s2: acceleration command actuated over the interval that ended now (a).
        compressor_power_w: compressor power actuated over the interval that ended now (P_cp), or the
            negative one of the heater.
        cell_1_temperature_k: temperature of the first cell of a coolant channel (T_bc,1).
        cell_n_temperature_k: temperature of the last cell of a coolant channel (T_bc,Nc).
        cell_1_capacity_loss: capacity loss of cell 1 as a fraction of nominal (Q_loss,1).
        cell_n_capacity_loss: capacity loss of cell N_c as a fraction of nominal (Q_loss,Nc).
        state_of_charge: charge left in the pack as a fraction of its present capacity; NaN: not known.
    """

    time_s: float
    position_m: float
    speed_m_s: float
    acceleration_m_s2: float
    compressor_power_w: float
    cell_1_temperature_k: float
    cell_n_temperature_k: float
    cell_1_capacity_loss: float
    cell_n_capacity_loss: float
    state_of_charge: float = field(default=math.nan, kw_only=True)


@dataclass(frozen=True, eq=False)
class ChannelCells:
    """Every cell of a channel in the order of the coolant: temperatures (K) and losses, shape (N_c,)."""

    temperatures_k: FloatArray = field(repr=False)
    capacity_losses: FloatArray = field(repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ChannelCells) and all(
            np.array_equal(values, getattr(other, name)) for name, values in vars(self).items()
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have none either

    @classmethod
    def between(cls, state: VehicleState, count: int) -> ChannelCells:
        """Return cells that lie evenly between the first and the last cell of a state."""
        first_k, last_k = state.cell_1_temperature_k, state.cell_n_temperature_k
        first, last = state.cell_1_capacity_loss, state.cell_n_capacity_loss
        temperatures_k = np.linspace(first_k, last_k, count, dtype=np.float64)
        return cls(temperatures_k, np.linspace(first, last, count, dtype=np.float64))


@dataclass(frozen=True)
class FullChannelState(VehicleState):
    """A vehicle state with every cell; its cells 1 and N_c are the first and the last of them."""

    cells: ChannelCells

    def __post_init__(self) -> None:
        temperatures, losses = self.cells.temperatures_k, self.cells.capacity_losses
        for name, values, place in (
            ("cell_1_temperature_k", temperatures, 0),
            ("cell_n_temperature_k", temperatures, -1),
            ("cell_1_capacity_loss", losses, 0),
            ("cell_n_capacity_loss", losses, -1),
        ):
            stated, value = getattr(self, name), values[place]
            if stated != value:
                raise StateError(f"state: {name} is {stated}; allowed: that of the cell, {value}")


@dataclass(frozen=True)
class IntervalPowers:
    """Mean powers over one interval in watts; mean times duration is the energy.

    Attributes:
        traction_power_w: drawn by the motor (P_tra), negative when it feeds back.
        compressor_power_w: drawn by the compressor (P_cp), or its negative by the heater.
        auxiliary_power_w: drawn by the auxiliaries of the cooling system (P_aux).
        battery_power_w: delivered by the pack (P_b), positive when discharging.
        chiller_heat_w: heat taken from the coolant (Q_co), positive when cooling.
        battery_heat_w: heat generated in all cells, ohmic and entropic; NaN where that is not known.
    """

    traction_power_w: float
    compressor_power_w: float
    auxiliary_power_w: float
    battery_power_w: float
    chiller_heat_w: float
    battery_heat_w: float = math.nan


class CommandSource(IntEnum):
    """Which command the vehicle carried out over an interval; the numbers travel in messages and bags."""

    ANSWER = 0
    """The controller's answer to the state at the start of the interval."""
    HELD = 1
    """Its answer to an earlier state, as none to this one had arrived."""
    STOP = 2
    """The controlled stop, for want of a command that can be carried out."""


@dataclass(frozen=True)
class SafetyRecord:
    """What the vehicle did of its own accord over an interval, and what its safety monitor measured.

    Attributes:
        service_braking_s: part of the interval in which it braked, from the request to the return of the
            acceleration into the limits of comfort.
        smallest_gap_m: smallest gap that the range sensor measured inside the interval; NaN for none.
        brake_share: share of the requested deceleration that the brakes deliver, as estimated.
        command_source: number of the `CommandSource`; NaN where it is not known.
    """

    service_braking_s: float = 0.0
    smallest_gap_m: float = math.nan
    brake_share: float = 1.0
    command_source: float = float(CommandSource.ANSWER)


@dataclass(frozen=True)
class PackReading:
    """Measurements of the pack beside its cells; NaN for those that are missing.

    Attributes:
        coolant_inlet_k: coolant entering the channels (T_c,in).
        coolant_outlet_k: coolant leaving the channels (T_c,out).
        battery_power_w: mean terminal power of the interval that ended now (P_b), positive when discharging.
    """

    coolant_inlet_k: float = math.nan
    coolant_outlet_k: float = math.nan
    battery_power_w: float = math.nan


@dataclass(frozen=True)
class PlantObservation:
    """What others learn of the plant at one instant.

    Attributes:
        powers: means over the interval that ended now; before the first one, 0 but for the compressor's.
        coolant_inlet_temperature_k: coolant entering the channels (T_c,in).
        coolant_outlet_temperature_k: coolant leaving the channels (T_c,out).
    """

    state: VehicleState
    powers: IntervalPowers
    coolant_inlet_temperature_k: float
    coolant_outlet_temperature_k: float
    safety: SafetyRecord

    @property
    def pack_reading(self) -> PackReading:
        """Measurements of the pack beside its cells."""
        return PackReading(
            self.coolant_inlet_temperature_k,
            self.coolant_outlet_temperature_k,
            self.powers.battery_power_w,
        )


@dataclass(frozen=True)
class BatteryReading:
    """Terminal values of the pack and of cells of a coolant channel.

    Cells are the first and the last one, or all in the order of the coolant. NaN: not measured.

    Attributes:
        pack_current_a: positive when discharging (sign of the paper; the message has the opposite sign).
        charge_ah: charge left.
        capacity_ah: capacity at present, aged.
        design_capacity_ah: nominal capacity.
    """

    time_s: float
    pack_voltage_v: float
    pack_current_a: float
    cell_voltages_v: tuple[float, ...]
    cell_temperatures_k: tuple[float, ...]
    charge_ah: float = math.nan
    capacity_ah: float = math.nan
    design_capacity_ah: float = math.nan


@dataclass(frozen=True)
class Command:
    """One decision, held for one sampling time: acceleration (a, m/s^2) and thermal power (P_cp, W).

    Positive power drives the compressor, negative power the heater.
    """

    acceleration_m_s2: float
    compressor_power_w: float


@dataclass(frozen=True)
class LeaderState:
    """The preceding vehicle at one instant: rear-bumper position (p_PV) and speed (v_PV)."""

    time_s: float
    position_m: float
    speed_m_s: float


@dataclass(frozen=True)
class LeaderPreview:
    """Motion of the preceding vehicle at nodes: its expected motion, and how far it may be behind.

    The one form from the predictor to the optimal control problem. A prediction begins at its generation.

    Attributes:
        times_s: node times, shape (n,), increasing, absolute (trip time).
        positions_m: expected rear-bumper positions at the nodes, shape (n,), never decreasing.
        speeds_m_s: expected speeds at the nodes, shape (n,), never negative.
        bounds_m: distances by which the leader may be behind these positions (99 % bounds), beyond the error
            of its present position, shape (n,), never negative; empty where the motion is known.
        speed_bounds_m_s: 99 % bounds of how much slower it may be where positions are known better than
            speeds, shape (n,); empty where implied by the growth of the other bounds. Not part of messages:
            the bridge has lowered the speeds by them.
    """

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray
    bounds_m: FloatArray = field(default_factory=partial(np.empty, 0))
    speed_bounds_m_s: FloatArray = field(default_factory=partial(np.empty, 0))

    @classmethod
    def empty(cls) -> LeaderPreview:
        """Return the preview that means "no prediction received yet"; its age is infinite."""
        return cls(np.empty(0), np.empty(0), np.empty(0))

    @property
    def generated_at_s(self) -> float:
        """Instant of the prediction, the time of its first node; minus infinity without nodes."""
        return self.times_s.item(0) if self.times_s.size else -math.inf

    def age_s(self, now_s: float) -> float:
        """Return the time since the generation, infinite for an empty preview."""
        return now_s - self.generated_at_s

    @property
    def known_nodes(self) -> int:
        """Number of nodes from the first one on whose bounds are at most `KNOWN_BOUND_M`."""
        if not self.bounds_m.size:
            return self.times_s.size
        unknown = self.bounds_m > KNOWN_BOUND_M
        return int(unknown.argmax()) if unknown.any() else self.bounds_m.size

    @property
    def known_until_s(self) -> float:
        """Time of the last known node; minus infinity if there is none."""
        return float(self.times_s[self.known_nodes - 1]) if self.known_nodes else -math.inf

    def cautious(self) -> LeaderPreview:
        """Return the motion that the leader hardly falls behind, without bounds.

        Positions are the expected ones less their bounds, but never decrease. Speeds are lowered by twice the
        mean rate of the bound since the first node: its rate now if it grows with the square of time, as that
        of an unknown acceleration does.
        """
        if not self.bounds_m.size:
            return self
        since = np.maximum(self.times_s - self.times_s[0], ROUNDING_S)
        rates = 2.0 * (self.bounds_m - self.bounds_m[0]) / since
        return LeaderPreview(
            self.times_s,
            np.maximum.accumulate(self.positions_m - self.bounds_m),
            np.maximum(self.speeds_m_s - rates, 0.0),
        )

    @property
    def lowest_speeds_m_s(self) -> FloatArray:
        """Speeds less their own bounds, shape (n,)."""
        if not self.speed_bounds_m_s.size:
            return self.speeds_m_s
        lowest: FloatArray = np.maximum(self.speeds_m_s - self.speed_bounds_m_s, 0.0)
        return lowest

    def nearer_by(self, distance_m: float) -> LeaderPreview:
        """Return the same motion of a vehicle that is nearer."""
        return replace(self, positions_m=self.positions_m - distance_m)

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and speeds at any times, shapes of ``times_s``.

        Between two nodes the speed is linear; the position is the cubic that meets both nodes in
        position and speed, which is the exact quadratic where the nodes are consistent. Outside the nodes
        the speed is held.
        """
        nodes = self.times_s
        if nodes.size == 1:
            speeds_m_s = np.full(times_s.shape, self.speeds_m_s[0])
            return self.positions_m[0] + self.speeds_m_s[0] * (times_s - nodes[0]), speeds_m_s
        index = nodes.searchsorted(times_s, side="right") - 1
        index = np.minimum(np.maximum(index, 0), nodes.size - 2)
        start, width = nodes[index], nodes[index + 1] - nodes[index]
        inside = np.minimum(np.maximum(times_s, nodes[0]), nodes[-1])
        tau = (inside - start) / width
        v_0, v_1 = self.speeds_m_s[index], self.speeds_m_s[index + 1]
        p_0, p_1 = self.positions_m[index], self.positions_m[index + 1]
        # Rest that a linear speed leaves over; zero for consistent nodes.
        rest = p_1 - p_0 - 0.5 * width * (v_0 + v_1)
        position = p_0 + width * tau * (v_0 + 0.5 * tau * (v_1 - v_0))
        position = position + rest * tau * tau * (3.0 - 2.0 * tau)
        speed = v_0 + tau * (v_1 - v_0)
        return position + speed * (times_s - inside), speed


@dataclass(frozen=True, eq=False)
class SlopePreview:
    """Road slope (theta, rad, positive uphill) at increasing positions, shape (n,); ends are held."""

    positions_m: FloatArray
    slopes_rad: FloatArray

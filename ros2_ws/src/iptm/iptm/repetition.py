"""Drives a trip over and over until the temperature of the pack repeats, so that no end is left to correct.

The lead vehicle goes on from the end of the trip to its start at `LINK_M_S2` at most, and so do road and
preview: no end is in sight. Every repetition is a closed loop of its own that begins with the motion of the
last end and with the charge of the trip. An optimal control settles at a temperature, and the pack is set
nearer to it by the drifts of the repetitions before. A thermostat has none; its repetitions follow each other
until its cycles close.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError
from iptm_core.metrics.repeated import (
    Repeated,
    Repetition,
    closed_stretch,
    over_cycles,
    without_drift,
)
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.routes.cycles import FINAL_BRAKING_M_S2, LeaderMotion
from iptm_core.routes.route import Route
from iptm_core.routes.slope import SlopeProfile
from iptm_core.settings import LeaderSource
from iptm_core.state import ChannelCells, FullChannelState, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_v2x_bridge.rules_of_the_road import road_bridge

if TYPE_CHECKING:
    from iptm.run import Run
    from iptm.trip import Trip
    from iptm_core.state import FloatArray
    from iptm_plant_sim.plant import Plant

LINK_M_S2 = 1.0
"""Acceleration of the lead vehicle from the end of a trip to its start, where their speeds differ."""
MOST_SETTLING, MOST_CYCLING = 12, 40
"""Repetitions at most, of an optimal control and of a thermostat."""
SETTLED = 1e-3
"""Relative error of energy and ageing below which no other repetition is driven."""
CONFIRMED = 2
"""Repetitions in a row that have to change nothing."""
FAR_K = 1.0
"""Distance from the settled temperature up to which the pack is left to settle by itself."""
MOST_KEPT = 0.9
"""Share of a drift, at most, that the next repetition is taken to have."""
SKIPPED = 3.0
"""Repetitions that one stands for besides itself until a thermostat switches for the first time."""
SKIPPED_K, MOST_SKIPPED = 0.3, 8
"""Drift, and number, of the repetitions that one stands for besides itself in its cycles."""
CYCLES_S, MOST_IN_CYCLES = 3600.0, 12
"""Time that the cycles of a thermostat are averaged over at least, and repetitions that suffice."""
LONGEST_S = 10800.0
"""Time after which an optimal control counts as settled."""
LEADING = 2
"""Switches of a thermostat that lead into its cycles."""
RETURNED_K_S = 1e-4
"""Drift per time over the cycles of a thermostat that counts as none; figures are corrected for it."""
SETTLING_TIME_S = 1000.0
"""First guess of the time in which a pack settles."""
LARGEST_STEP_K = 6.0
SAME_LEADER_M = 5.0
"""Distance from the lead vehicle of the trip up to which a measured one is the same."""
_JOINT_M = 1.0
_KNOWN: WeakKeyDictionary[Trajectory, Repeated | None] = WeakKeyDictionary()
"""Figures of runs that have been repeated."""


@dataclass(frozen=True)
class _End:
    """State with which a repetition ends and the next one begins."""

    gap_m: float
    speed_m_s: float
    acceleration_m_s2: float
    compressor_power_w: float
    cell_1_k: float
    cell_n_k: float
    is_cooling: bool

    @classmethod
    def of(cls, run: Trajectory, *, is_cooling: bool) -> _End:
        return cls(
            float(run.gap_m[-1]),
            float(run.speed_m_s[-1]),
            float(run.acceleration_m_s2[-1]),
            float(run.compressor_power_w[-1]),
            float(run.cell_1_temperature_k[-1]),
            float(run.cell_n_temperature_k[-1]),
            is_cooling,
        )

    @property
    def mean_k(self) -> float:
        return 0.5 * (self.cell_1_k + self.cell_n_k)

    def at(self, mean_k: float) -> _End:
        """Return the same end with another mean temperature."""
        step_k = mean_k - self.mean_k
        return replace(self, cell_1_k=self.cell_1_k + step_k, cell_n_k=self.cell_n_k + step_k)


def why_not(run: Run) -> str:
    """Return why a run cannot be driven over and over; empty if it can."""
    trip = run.trip
    if trip is None:
        return "its trip is not known"
    known = trip.settings
    own = [name for name, value in run.settings.items() if known.get(name) != value]
    if own or trip.foreign:
        return f"own {', '.join([*own, *sorted(trip.foreign)])}"
    if trip.conditions.faults:
        return "it has faults"
    if len(run.trajectory) != trip.ticks + 1:
        return "it does not cover its trip"
    if trip.rules.leader_source is not LeaderSource.CYCLE or trip.rules.keeps_rules:
        return "it does not follow the lead vehicle of a cycle alone"
    rows, leader = run.trajectory, trip.route.leader
    apart_m = np.abs(rows.leader_position_m - leader.positions_at(rows.time_s - rows.time_s[0]))
    # Also NaN, where there is none; a vehicle in a string follows another one.
    return (
        "" if apart_m.max() < SAME_LEADER_M else "it follows another vehicle than its trip states"
    )


def repeat(run: Run) -> Repeated | None:
    """Drive the trip of a run until the temperature of the pack repeats; None where that is not possible."""
    if run.trajectory not in _KNOWN:
        _KNOWN[run.trajectory] = None if why_not(run) else _repeat(run)
    return _KNOWN[run.trajectory]


def _repeat(run: Run) -> Repeated | None:
    if run.trip is None:
        return None
    rows = run.trajectory
    end = _End.of(rows, is_cooling=float(rows.compressor_power_w[-1]) > 0.0)
    try:
        tile = _Tile(run.trip)
        follows_rules = STRATEGIES[run.trip.controller.strategy].is_rule_based
        return _cycled(tile, end) if follows_rules else _settled(tile, end)
    except IptmError:  # as a pack that is empty before its end
        return None


def _settled(tile: _Tile, end: _End) -> Repeated:
    """Let the pack settle, and return the figures of a repetition that begins as warm as it ends.

    Where its temperature is far from settling, it is set nearer to where it would. One repetition after that
    does not count: the difference of the cells has to follow.
    """
    done, end = tile.drive(end)
    tiles, driven = [done], 1
    settles = -math.expm1(-tile.duration_s / SETTLING_TIME_S)
    step_k = _bounded(done.drift_k * (1.0 - settles) / settles)
    found: Repeated | None = None
    same = 0
    most = min(max(math.floor(LONGEST_S / tile.duration_s), 4), MOST_SETTLING)
    while True:
        left = most - driven
        if abs(step_k) > FAR_K and left > 1:
            _, end = tile.drive(end.at(end.mean_k + step_k))
            driven += 1
        done, end = tile.drive(end)
        tiles.append(done)
        driven += 1
        before, found = found, without_drift(tiles, driven)
        same = same + 1 if _is_same(before, found) else 0
        if driven >= most or same == CONFIRMED:
            return found
        kept = 0.0
        if len(tiles) > 2 and tiles[-2].drift_k:
            kept = min(max(done.drift_k / tiles[-2].drift_k, 0.0), MOST_KEPT)
        step_k = _bounded(done.drift_k * kept / (1.0 - kept))


def _cycled(tile: _Tile, end: _End) -> Repeated:
    """Drive one repetition after the other until the cycles of a thermostat close.

    One that drifts little stands for several. The first two switches lead into its cycles.
    """
    tiles: list[Repetition] = []
    found: Repeated | None = None
    switched = 0
    fewest = min(math.ceil(CYCLES_S / tile.duration_s), MOST_IN_CYCLES)
    for driven in range(1, MOST_CYCLING + 1):
        done, end = tile.drive(end)
        if tiles and (done.drift_k < 0.0) != (tiles[-1].drift_k < 0.0):
            switched += 1
            tiles = tiles if switched > LEADING else []
        if not switched:
            tiles.append(done)
            before, found = found, without_drift(tiles[-2:], driven)
            if _is_same(before, found):
                return found
            end = end.at(end.mean_k + _bounded(SKIPPED * done.drift_k))
            continue
        more = min(math.floor(SKIPPED_K / max(abs(done.drift_k), 1e-3)), MOST_SKIPPED)
        tiles += [done] * (1 + more)
        end = end.at(end.mean_k + more * done.drift_k)
        if switched > LEADING:
            first, last = closed_stretch(tiles)
            mean_k = sum(each.drift_k for each in tiles[first:last]) / (last - first)
            is_closed = abs(mean_k) < RETURNED_K_S * tile.duration_s
            if is_closed and last - first >= fewest:
                break
    return over_cycles(tiles, driven)


def _is_same(before: Repeated | None, found: Repeated) -> bool:
    """Return whether one more repetition has changed nothing."""
    if before is None or not found.capacity_loss:
        return before is not None
    changes = (
        before.energy_per_distance_j_m / found.energy_per_distance_j_m - 1.0,
        before.capacity_loss / found.capacity_loss - 1.0,
    )
    return max(*map(abs, changes), found.energy_error, found.aging_error) < SETTLED


def _bounded(step_k: float) -> float:
    return min(max(step_k, -LARGEST_STEP_K), LARGEST_STEP_K)


class _Tile:
    """One repetition of a trip: link from its end to its start, then the trip, with what follows in sight."""

    def __init__(self, trip: Trip) -> None:
        route, tick_s = trip.route, trip.conditions.period_s
        one = _one(route, tick_s)
        self.duration_s = float(one[0][-1])
        beyond_s = max(trip.preview.preview_length_s, trip.options.horizon.duration_s)
        copies = 2 + math.floor(beyond_s / self.duration_s)
        whole = _repeated_route(route, one, copies)
        self._route = replace(whole, duration_s=self.duration_s)
        # A kelvin has its value for the rest of a trip, and this one has no end.
        self._trip = replace(trip)
        vars(self._trip)["route"] = replace(whole, duration_s=math.inf)

    def drive(self, end: _End) -> tuple[Repetition, _End]:
        """Drive a repetition from the end of the one before, and return its figures and its end."""
        from iptm.driving import controller_for, plant_for  # noqa: PLC0415  it imports this package

        trip = self._trip
        plant, controller = plant_for(trip), controller_for(trip)
        if isinstance(controller, MpcController):
            controller.memory = replace(controller.memory, is_cooling=end.is_cooling)
        source, bridge = road_bridge(trip.rules, self._route, trip.parameters, trip.preview)
        start = _start(plant, end, self._route.leader.start_position_m - end.gap_m)
        loop = run_closed_loop(
            self._route, plant, controller, bridge=bridge, leader=source, start=start
        )
        metrics = compute_metrics(loop.trajectory, trip.parameters)
        body = trip.parameters.body
        kinetic_j = 0.5 * body.rotational_inertia_factor * body.mass_kg * end.speed_m_s**2
        is_cooling = isinstance(controller, MpcController) and controller.memory.is_cooling
        return (
            Repetition.of(metrics, end.mean_k, kinetic_j),
            _End.of(loop.trajectory, is_cooling=is_cooling),
        )


def _start(plant: Plant, end: _End, position_m: float) -> VehicleState:
    state = replace(
        plant.initial_state(position_m, end.speed_m_s, end.cell_n_k),
        acceleration_m_s2=end.acceleration_m_s2,
        compressor_power_w=end.compressor_power_w,
        cell_1_temperature_k=end.cell_1_k,
    )
    if isinstance(state, FullChannelState):
        cells = ChannelCells.between(state, plant.parameters.pack.cells_per_channel)
        state = replace(state, cells=cells)
    return state


def _one(route: Route, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """Return times (s) and speeds (m/s) of the lead vehicle from the end of a trip to its next end."""
    leader, end_s = route.leader, route.duration_s
    inside = leader.times_s[(leader.times_s > 0.0) & (leader.times_s < end_s)]
    times = np.concatenate(([0.0], inside, [end_s]))
    speeds = leader.speeds_at(times)
    link_s = math.ceil(abs(speeds[-1] - speeds[0]) / LINK_M_S2 / tick_s) * tick_s
    if not link_s:
        return times, speeds
    return np.concatenate(([0.0], times + link_s)), np.concatenate((speeds[-1:], speeds))


def _repeated_route(route: Route, one: tuple[FloatArray, FloatArray], copies: int) -> Route:
    times, speeds = one
    length_s = times[-1]
    name = f"{route.name}, repeated"
    all_s = np.concatenate([times[:1], *(times[1:] + k * length_s for k in range(copies))])
    all_m_s = np.concatenate([speeds[:1], *(speeds[1:] for _ in range(copies))])
    # Beyond the last copy, which no preview of the repetition reaches, the lead vehicle stops.
    stop_s = all_s[-1] + 1.0 + all_m_s[-1] / FINAL_BRAKING_M_S2
    leader = LeaderMotion(
        np.append(all_s, stop_s), np.append(all_m_s, 0.0), route.leader.start_position_m
    )
    return replace(
        route, name=name, leader=leader, slope=_repeated_slope(route, leader, length_s, copies)
    )


def _repeated_slope(
    route: Route, leader: LeaderMotion, length_s: float, copies: int
) -> SlopeProfile:
    slope = route.slope
    if slope.positions_m.size == 1:
        return slope
    begin_m = route.leader.start_position_m
    trip_m = float(route.leader.positions_at(route.duration_s)) - begin_m
    tile_m = float(leader.positions_at(length_s)) - begin_m
    inside = (slope.positions_m > 0.0) & (slope.positions_m < trip_m - _JOINT_M)
    places = np.concatenate(([0.0], slope.positions_m[inside], [trip_m - _JOINT_M]))
    slopes = slope.slope_at(places)
    ahead_m = tile_m - trip_m
    return SlopeProfile(
        np.concatenate([places + ahead_m + k * tile_m for k in range(copies)]),
        np.tile(slopes, copies),
    )

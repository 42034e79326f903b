"""Drives a trip over and over until the temperature of the pack repeats, so that no end is left to correct.

The lead vehicle goes on from the end of the trip to its start at `LINK_M_S2` at most, and so do road and
preview: no end is in sight. Every repetition is a closed loop of its own that begins with the motion of the
last end and with the charge of the trip. An optimal control settles at temperatures of both cells, the fixed
point of the repetitions, found by Anderson's acceleration. A thermostat has none; its repetitions follow each
other until its cycles close.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.metrics.repeated import (
    NOTED_DRIFT_K,
    Repeated,
    Repetition,
    over_cycles,
    over_noise,
    over_open_cycles,
    settling_weights,
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
MOST_SETTLING, MOST_CYCLING = 8, 24
"""Repetitions at most, of an optimal control and of a thermostat."""
SETTLED = 2e-3
"""Relative error of energy and ageing below which no other repetition is driven."""
CLOSED = 4e-3
"""The same of the cycles of a thermostat."""
SETTLED_ABOVE_LIMIT_K, SETTLED_APART_K = 0.5, 1.5
"""First guess of where an optimal control settles that arrives warmer: its mean above the lower temperature
limit, and the difference of the cells at most."""
LARGEST_STEP_K = 12.0
"""Largest step of the acceleration."""
PROBED_REPETITIONS, LEAST_PROBE_K = 25.0, 2.0
"""A pack whose drift does not fade is made warmer or cooler by its drift over this number of repetitions, by
at least the second value: about where it settles, as its time constant is 20 to 50 repetitions."""
RESOLVED = 0.5
"""Share of a drift that the weights must take out; else where it ends is not known."""
REGULATED_K, REGULATED = 0.2, 5
"""Largest drift of a cell, while the compressor runs, that is noise of the control; and of how many such
repetitions the mean is taken."""
LEADING = 1
"""Switches of a thermostat that lead into its cycles."""
SKIPPED_K, MOST_SKIPPED = 0.3, 6
"""Drift, and number, of the repetitions that one stands for besides itself in its cycles."""
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
    has_cooled: bool

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
            bool((run.compressor_power_w > 0.0).any()),
        )

    @property
    def cells_k(self) -> FloatArray:
        return np.array([self.cell_1_k, self.cell_n_k])

    @property
    def mean_k(self) -> float:
        return 0.5 * (self.cell_1_k + self.cell_n_k)

    def at(self, cells_k: FloatArray) -> _End:
        """Return the same end with other temperatures of the cells."""
        return replace(self, cell_1_k=float(cells_k[0]), cell_n_k=float(cells_k[1]))


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


def one_after_the_other(run: Run) -> Iterator[Repetition]:
    """Yield repetitions of the trip of a run without end, each from where the one before has ended.

    Raises:
        ScenarioError: the run cannot be driven over and over.
    """
    if run.trip is None or why_not(run):
        raise ScenarioError(f"{run.name} cannot be repeated: {why_not(run)}")
    tile = _Tile(run.trip)
    end = _first_end(run)
    while True:
        done, end = tile.drive(end)
        yield done


def _first_end(run: Run) -> _End:
    rows = run.trajectory
    return _End.of(rows, is_cooling=float(rows.compressor_power_w[-1]) > 0.0)


def _repeat(run: Run) -> Repeated | None:
    if run.trip is None:
        return None
    controller, end = run.trip.controller, _first_end(run)
    try:
        tile = _Tile(run.trip)
        if STRATEGIES[controller.strategy].is_rule_based:
            switching_k = controller.thermostat_off_k, controller.thermostat_on_k
            return _cycled(tile, end, switching_k)
        limit_k = run.parameters.limits.min_temperature_k + SETTLED_ABOVE_LIMIT_K
        if end.mean_k > limit_k:
            half_k = 0.5 * min(end.cell_n_k - end.cell_1_k, SETTLED_APART_K)
            end = end.at(np.array([limit_k - half_k, limit_k + half_k]))
        return _settled(tile, end, limit_k)[0]
    except IptmError:  # as a pack that is empty before its end
        return None


def _settled(
    tile: _Tile, end: _End, warmest_k: float, *, cycles: bool = False
) -> tuple[Repeated | None, _End]:
    """Let the pack settle.

    Args:
        tile: the trip.
        end: with which the first repetition begins.
        warmest_k: mean temperature up to which the acceleration takes the pack; it warms further by itself.
        cycles: whether it does not settle where the compressor runs.

    Returns:
        Figures of a repetition that begins as warm as it ends, None where it does not settle; and the end.
    """
    tiles: list[Repetition] = []
    ends_k: list[FloatArray] = []
    regulated: list[Repetition] = []
    found: Repeated | None = None
    for driven in range(1, MOST_SETTLING + 1):
        done, end = tile.drive(end)
        if cycles and end.has_cooled:
            return None, end
        tiles.append(done)
        ends_k.append(end.cells_k)
        before, found = found, without_drift(tiles, driven)
        weights = settling_weights(tiles)
        left_k = np.abs(weights @ [each.drifts_k for each in tiles]).max()
        is_resolved = left_k <= max(NOTED_DRIFT_K, RESOLVED * np.abs(done.drifts_k).max())
        if is_resolved and _is_same(before, found):
            break
        if end.has_cooled and np.abs(done.drifts_k).max() <= REGULATED_K:
            # Weights of noise would lead far away.
            regulated.append(done)
            if len(regulated) == REGULATED:
                return over_noise(regulated, driven), end
            continue
        proposed_k = weights @ ends_k
        if not is_resolved and not end.has_cooled:
            probe_k = max(PROBED_REPETITIONS * abs(done.drift_k), LEAST_PROBE_K)
            proposed_k = end.cells_k + math.copysign(probe_k, done.drift_k)
        end = end.at(_next(end, done.drift_k, proposed_k, warmest_k))
    return found, end


def _cycled(tile: _Tile, end: _End, switching_k: tuple[float, float]) -> Repeated:
    """Drive one repetition after the other until the cycles of a thermostat close.

    One that drifts little stands for several. Where the pack settles below the temperatures at which the
    thermostat switches, there are no cycles.

    Args:
        tile: the trip.
        end: with which the first repetition begins.
        switching_k: temperatures at which the thermostat switches off and on.
    """
    middle_k = 0.5 * sum(switching_k)
    if end.mean_k < middle_k:
        found, end = _settled(tile, end, middle_k, cycles=True)
        if found is not None:
            return found
    end = end.at(end.cells_k + min(middle_k - end.mean_k, 0.0))
    tiles: list[Repetition] = []
    switched = 0
    for driven in range(1, MOST_CYCLING + 1):
        done, end = tile.drive(end)
        if tiles and (done.drift_k < 0.0) != (tiles[-1].drift_k < 0.0):
            switched += 1
        more = min(math.floor(SKIPPED_K / max(abs(done.drift_k), 1e-3)), MOST_SKIPPED)
        tiles += [done] * (1 + more)
        end = end.at(end.cells_k + more * done.drift_k)
        if switched > LEADING:
            found = over_cycles(tiles, driven)
            if max(found.energy_error, found.aging_error) < CLOSED:
                return found
    return over_open_cycles(tiles, driven)


def _is_same(before: Repeated | None, found: Repeated) -> bool:
    """Return whether one more repetition has changed nothing."""
    if before is None or not found.capacity_loss:
        return before is not None
    changes = (
        before.energy_per_distance_j_m / found.energy_per_distance_j_m - 1.0,
        before.capacity_loss / found.capacity_loss - 1.0,
    )
    return max(*map(abs, changes), found.energy_error, found.aging_error) < SETTLED


def _next(end: _End, drift_k: float, cells_k: FloatArray, warmest_k: float) -> FloatArray:
    """Return the temperatures of the cells from which the next repetition begins.

    Args:
        end: of the last repetition.
        drift_k: of the last repetition.
        cells_k: proposed.
        warmest_k: see `_settled`.
    """
    step_k = float(np.mean(cells_k)) - end.mean_k
    allowed_k = min(max(step_k, -LARGEST_STEP_K), LARGEST_STEP_K)
    if (
        step_k + drift_k
    ) * drift_k < 0.0:  # behind the start of the last one: drifts that do not fade
        allowed_k = math.copysign(LARGEST_STEP_K, drift_k)
    return cells_k + min(allowed_k, max(warmest_k - end.mean_k, 0.0)) - step_k


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
        after = _End.of(loop.trajectory, is_cooling=is_cooling)
        drifts_k = after.cell_1_k - end.cell_1_k, after.cell_n_k - end.cell_n_k
        return Repetition.of(metrics, drifts_k, kinetic_j), after


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

"""Cut-in and cut-out of UN Regulation 157 (Annex 4, appendix 3): two driver models and the safety monitor.

The careful driver of the regulation coasts for 0.75 s with 0.4 m/s^2 and then builds up 0.774 g. The fuzzy
driver (K. Mattas et al., "Fuzzy surrogate safety metrics for real-time assessment of rear-end collision
risk", Accident Analysis & Prevention 148, 2020) waits as long, and brakes in proportion to a proactive and a
critical metric. Written from these descriptions; grids, sizes and starts as in the comparison that the Joint
Research Centre published. The own vehicle is the simulated one, coasting, with its safety monitor alone.

The drivers see both lanes; the range sensor sees a vehicle from where it crosses the marking of the lane, and
a standing one, as the drivers do, from where the vehicle between leaves its wandering zone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
import pandas as pd
from studies.collisions.recorded import RecordedPlant

from iptm_core.braking import GRAVITY_M_S2
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, FloatArray, LeaderPreview, VehicleState

LENGTH_M, WIDTH_M, LANE_M = 4.3, 1.9, 3.5
STEP_S, LONGEST_S, TICK_S = 0.1, 35.0, 1.0
"""Steps of the drivers and of the range sensor, longest trip, and tick of the own vehicle, whose motion is
judged at the steps of `RecordedPlant`: within a tick it may pass through another vehicle."""
WANDERING_M = 0.375
APART_M = LANE_M - WIDTH_M
"""Between the sides of two vehicles in the middle of neighbouring lanes."""
MARKING_M = 0.5 * APART_M
"""Between the sides when one vehicle crosses the marking."""
SIDEWAYS_M_S2 = 1.5
REACTION_S, JERK_M_S3, HARDEST_M_S2 = 0.75, 12.65, 0.774 * GRAVITY_M_S2
COASTING_M_S2, CAREFUL_TTC_S, CAREFUL_HEADWAY_S = 0.4, 2.0, 2.0
GENTLE_M_S2, FUZZY_HARD_M_S2, AHEAD_M_S2, MARGIN_M = 4.0, 6.0, 7.0, 2.0
CAREFUL, FUZZY = "careful", "fuzzy"
CUT_IN, CUT_OUT = "cut-in", "cut-out"
COAST = Command(0.0, 0.0)


@dataclass(frozen=True)
class Case:
    """One case of a grid; lengths between bumpers, speeds in m/s.

    Attributes:
        kind: cut-in or cut-out.
        speed_m_s: of the own vehicle.
        other_m_s: of the vehicle that cuts in; that which cuts out drives as fast as the own one.
        distance_m: to the vehicle that cuts in where its sideways speed is reached, or from the vehicle that
            cuts out to the standing one.
        sideways_m_s: speed across the lane.
    """

    kind: str
    speed_m_s: float
    other_m_s: float
    distance_m: float
    sideways_m_s: float

    @property
    def begins_s(self) -> float:
        """Time at which the vehicle begins to move sideways."""
        return -self.sideways_m_s / SIDEWAYS_M_S2 if self.kind == CUT_IN else 0.0

    def between_sides_m(self, time_s: float) -> float:
        """Return how far the sides of the own vehicle and of the one that cuts in are apart, at least 0."""
        if time_s < 0.0:
            return APART_M + 0.5 * SIDEWAYS_M_S2 * time_s * time_s
        return max(APART_M - self.sideways_m_s * time_s, 0.0)

    @property
    def crash_s(self) -> float:
        """When the vehicle that cuts out hits the standing one; infinity if it passes it."""
        at_s = self.distance_m / self.speed_m_s
        return at_s if at_s * self.sideways_m_s < WIDTH_M else np.inf


def grid(stride: int) -> Iterator[Case]:
    """Return the cases at a stride of the distances and sideways speeds of the published grids."""
    fast = ((70, 90, 110, 130), 30, np.arange(1.0, 120.0, 2.0))
    slow = ((10, 20, 30, 40, 50, 60), 10, np.arange(1.0, 60.0))
    for speeds, step, distances in (fast, slow):
        sideways = np.arange(0.1, 1.75, 0.1)[::stride]
        for speed, distance, lateral in product(speeds, distances[::stride], sideways):
            for other in range(10, speed, step):
                yield Case(CUT_IN, speed / 3.6, other / 3.6, float(distance), float(lateral))
    distances, sideways = np.arange(2.0, 152.0, 5.0), np.arange(0.1, 3.05, 0.2)
    cells = product(range(10, 131, 10), distances[::stride], sideways[::stride])
    for speed, distance, lateral in cells:
        yield Case(CUT_OUT, speed / 3.6, 0.0, float(distance), float(lateral))


def proactive(gap_m: float, speed_m_s: float, ahead_m_s: float) -> float:
    """Return the proactive metric: 0 from the safe distance on, 1 below the unsafe one."""
    ahead_m = ahead_m_s * ahead_m_s / (2.0 * AHEAD_M_S2)
    stop_m = speed_m_s * REACTION_S - ahead_m
    safe_m = stop_m + speed_m_s * speed_m_s / (2.0 * GENTLE_M_S2) + MARGIN_M
    unsafe_m = stop_m + speed_m_s * speed_m_s / (2.0 * FUZZY_HARD_M_S2)
    return float(np.clip((safe_m - gap_m + MARGIN_M) / (safe_m - unsafe_m), 0.0, 1.0))


def critical(gap_m: float, speed_m_s: float, ahead_m_s: float, acceleration_m_s2: float) -> float:
    """Return the critical metric, from the relative motion."""
    if speed_m_s <= ahead_m_s:
        return 0.0
    acceleration = max(acceleration_m_s2, -GENTLE_M_S2)
    closing_m_s = speed_m_s - ahead_m_s
    later_m_s = closing_m_s + acceleration * REACTION_S
    if later_m_s < 0.0:
        return float(gap_m < closing_m_s**2 / (2.0 * abs(acceleration)))
    reaction_m = REACTION_S * 0.5 * (closing_m_s + later_m_s)
    safe_m = reaction_m + later_m_s**2 / (2.0 * GENTLE_M_S2)
    unsafe_m = reaction_m + later_m_s**2 / (2.0 * FUZZY_HARD_M_S2)
    if safe_m - unsafe_m < 1e-9:
        return float(gap_m < safe_m)
    return float(np.clip((safe_m - gap_m) / (safe_m - unsafe_m), 0.0, 1.0))


def driver_gap_m(case: Case, model: str) -> float:
    """Return the smallest gap of a driver model while the other vehicle is in its way, 0 for a collision."""
    speed, acceleration, own_m, waited_s, braking = case.speed_m_s, 0.0, 0.0, 0.0, 0.0
    start_m, smallest_m = model_start_m(case, model), np.inf
    for time_s in np.arange(case.begins_s, LONGEST_S, STEP_S).tolist():
        other_m, other_m_s, in_way = _other(case, time_s, start_m)
        gap_m = other_m - own_m
        if in_way and gap_m > -2.0 * LENGTH_M:
            smallest_m = min(smallest_m, max(gap_m, 0.0))
        if smallest_m <= 0.0 or speed <= 0.0 or gap_m < -2.0 * LENGTH_M:
            break
        wanted = 0.0
        if gap_m > 0.0:
            wanted = _wanted(case, model, time_s, gap_m, speed, other_m_s, acceleration)
        if wanted > 0.0 and waited_s < REACTION_S - 1e-9:
            waited_s += STEP_S
            acceleration = -COASTING_M_S2 if model == CAREFUL else 0.0
        elif wanted > 0.0:
            braking = min(braking + JERK_M_S3 * STEP_S, HARDEST_M_S2, wanted)
            acceleration = -braking
        else:
            acceleration = 0.0
        speed_after = max(speed + acceleration * STEP_S, 0.0)
        own_m += 0.5 * (speed + speed_after) * STEP_S
        speed = speed_after
    return float(smallest_m)


def cut_in_start_m(case: Case) -> float:
    """Return where the vehicle that cuts in is at 0 s, from where the own one begins before."""
    return case.distance_m - case.speed_m_s * case.begins_s


def model_start_m(case: Case, model: str) -> float:
    """Return the gap to the vehicle ahead at which a model begins: its own where one leaves the lane."""
    if case.kind == CUT_IN:
        return cut_in_start_m(case)
    speed = case.speed_m_s
    if model == CAREFUL:
        return CAREFUL_HEADWAY_S * speed
    stop_m = speed * speed * (0.5 / GENTLE_M_S2 - 0.5 / AHEAD_M_S2)
    return speed * REACTION_S + stop_m + 2.0 * MARGIN_M


def _other(case: Case, time_s: float, start_m: float) -> tuple[float, float, bool]:
    """Return position of the rear and speed of the vehicle that counts, and whether it is in the way."""
    if case.kind == CUT_IN:
        in_way = case.between_sides_m(time_s) <= 0.0
        return start_m + case.other_m_s * time_s, case.other_m_s, in_way
    if time_s >= case.crash_s:
        return start_m + case.speed_m_s * case.crash_s, 0.0, True
    if case.sideways_m_s * time_s < WANDERING_M:
        return start_m + case.speed_m_s * time_s, case.speed_m_s, True
    return start_m + LENGTH_M + case.distance_m, 0.0, True


def _wanted(
    case: Case,
    model: str,
    time_s: float,
    gap_m: float,
    speed: float,
    other_m_s: float,
    acceleration: float,
) -> float:
    """Return the deceleration that a model asks for, 0 for none."""
    closing_m_s = speed - other_m_s
    in_way = case.kind == CUT_OUT or case.between_sides_m(time_s) <= 0.0
    if model == CAREFUL:
        if case.kind == CUT_OUT:
            return HARDEST_M_S2 if closing_m_s > 0.0 else 0.0
        is_critical = closing_m_s > 0.0 and gap_m / closing_m_s <= CAREFUL_TTC_S
        return HARDEST_M_S2 if in_way and is_critical else 0.0
    if not in_way and closing_m_s > 0.0:
        arrives_s = case.between_sides_m(time_s) / case.sideways_m_s
        if arrives_s > (gap_m + 2.0 * LENGTH_M) / closing_m_s + STEP_S:
            return 0.0
    elif not in_way:
        return 0.0
    worst = critical(gap_m, speed, other_m_s, acceleration)
    if worst > 0.0:
        return GENTLE_M_S2 + worst * (FUZZY_HARD_M_S2 - GENTLE_M_S2)
    return GENTLE_M_S2 * proactive(gap_m, speed, other_m_s)


class OwnCar:
    """The simulated vehicle, of which only the safety monitor acts."""

    def __init__(self) -> None:
        self._plant = RecordedPlant(load_parameters().values, np.zeros_like)

    def gap_m(self, case: Case, shown_m: float = MARKING_M, start_m: float | None = None) -> float:
        """Return the smallest gap, 0 for a collision.

        Args:
            shown_m: distance between the sides from which on the range sensor shows a vehicle that cuts in.
            start_m: gap to the vehicle ahead at the start; by default the safe distance of the monitor.
        """
        start_m = self._start_m(case) if start_m is None else start_m
        times_s = np.arange(0.0, TICK_S - 1e-9, STEP_S)

        def sensor(state: VehicleState) -> LeaderPreview:
            rows = []
            for time_s in (state.time_s + times_s).tolist():
                trip_s = time_s + case.begins_s
                other_m, other_m_s, _ = _other(case, trip_s, start_m)
                hidden = case.kind == CUT_IN and case.between_sides_m(trip_s) > shown_m
                own_m = state.position_m + state.speed_m_s * (time_s - state.time_s)
                if not hidden and other_m > own_m:
                    rows.append((time_s, other_m, other_m_s))
            return LeaderPreview(*np.array(rows).T) if rows else LeaderPreview.empty()

        self._plant.watch(sensor)
        state = self._plant.initial_state(speed_m_s=case.speed_m_s)
        smallest_m = np.inf
        self._plant.parts.clear()
        while state.time_s < LONGEST_S and state.speed_m_s > 0.01:
            driven = len(self._plant.parts)
            state = self._plant.advance(state, COAST, TICK_S).state
            driven_s, own_m, _, _ = self._plant.motion(driven)
            smallest_m = min(smallest_m, _smallest_gap_m(case, driven_s, own_m, start_m))
            if smallest_m <= 0.0:
                return 0.0
        return float(smallest_m)

    def _start_m(self, case: Case) -> float:
        if case.kind == CUT_IN:
            return cut_in_start_m(case)
        monitor, speed = self._plant.monitor, case.speed_m_s
        road = monitor.road_braking()
        return max(
            monitor.safe_distance_m(speed, 0.0, speed, capability=one)
            for one in (road.full, road.slippery or road.full)
        )


def _smallest_gap_m(case: Case, times_s: FloatArray, own_m: FloatArray, start_m: float) -> float:
    """Return the smallest gap to a vehicle in the way at times of the own trip, infinite for none."""
    trip_s: FloatArray = times_s + case.begins_s
    other_m: FloatArray
    if case.kind == CUT_IN:
        other_m = start_m + case.other_m_s * trip_s
        apart_m = np.where(
            trip_s < 0.0,
            APART_M + 0.5 * SIDEWAYS_M_S2 * trip_s * trip_s,
            np.maximum(APART_M - case.sideways_m_s * trip_s, 0.0),
        )
        in_way = apart_m <= 0.0
    else:
        leaves = start_m + case.speed_m_s * np.minimum(trip_s, case.crash_s)
        is_ahead = (trip_s >= case.crash_s) | (case.sideways_m_s * trip_s < WANDERING_M)
        other_m = np.where(is_ahead, leaves, start_m + LENGTH_M + case.distance_m)
        in_way = np.full(trip_s.size, fill_value=True)
    gaps_m = other_m - own_m
    counts = in_way & (gaps_m > -2.0 * LENGTH_M)
    return float(gaps_m[counts].min()) if counts.any() else np.inf


def outcomes(stride: int, part: int = 0, parts: int = 1) -> pd.DataFrame:
    """Return a row per case of the grids, see `grid`, or of every so-many-th of them from one on.

    It has the values of the case, and the smallest gaps of each driver and of the own vehicle in m:
    ``own_m`` of the own vehicle as it is; ``granted_m``, where only a driver avoids the collision, of the own
    vehicle with this driver's advantage: it sees the neighbouring lane, or starts from the driver's gap.
    """
    car, rows = OwnCar(), []
    for case in islice(grid(stride), part, None, parts):
        found = {model: driver_gap_m(case, model) for model in (CAREFUL, FUZZY)}
        own_m = granted_m = car.gap_m(case)
        if own_m <= 0.0 < max(found.values()):
            start_m = max(model_start_m(case, model) for model in found if found[model] > 0.0)
            granted_m = car.gap_m(case, np.inf, start_m)
        gaps = {f"{model}_m": gap_m for model, gap_m in found.items()}
        rows.append({**vars(case), **gaps, "own_m": own_m, "granted_m": granted_m})
    return pd.DataFrame(rows)


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per kind: cases, collisions, and what a driver avoids and the own vehicle does not.

    A driver whose smallest gap is infinite passes before the other vehicle is in the way.
    """
    hits = table.own_m <= 0.0
    by_careful, by_fuzzy = (hits & (table[f"{driver}_m"] > 0.0) for driver in (CAREFUL, FUZZY))
    missed = by_careful | by_fuzzy
    passed = hits & (np.isinf(table.careful_m) | np.isinf(table.fuzzy_m))
    marked = table.assign(
        cases=1,
        careful=table[f"{CAREFUL}_m"] <= 0.0,
        fuzzy=table[f"{FUZZY}_m"] <= 0.0,
        own=hits,
        missed=missed,
        missed_careful=by_careful,
        missed_fuzzy=by_fuzzy,
        passed=passed,
        unexplained=missed & (table.granted_m <= 0.0) & ~passed,
    )
    columns = [
        *("cases", "careful", "fuzzy", "own"),
        *("missed_careful", "missed_fuzzy", "missed", "passed", "unexplained"),
    ]
    return marked.groupby("kind", sort=False)[columns].sum().astype(int).reset_index()

"""Trials of the families in closed loop, judged every 0.01 s from the true motions.

A collision is avoidable if a driver who sees all of it, reacts after 1 s and brakes as hard as brakes and
road permit would have avoided it, from the onset on. Behind a blind range sensor it is explained where even
brakes that act at once when the sensor is sound again come too late.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from studies.bounds import emergency_stops
from studies.collisions.families import (
    FAMILIES,
    LIE_OF_NOW,
    OF_SENSOR_ALONE,
    PUBLISHED,
    TWO,
    Draw,
    Family,
    Motion,
)
from studies.collisions.recorded import STEP_S, RecordedPlant
from studies.session import Session

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.decision import ControllerMemory, Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_core.braking import (
    GRAVITY_M_S2,
    RadioSettings,
    SafetyMonitorSettings,
    tyre_deceleration_m_s2,
)
from iptm_core.errors import ScenarioError
from iptm_core.markdown import NO_VALUE
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.slope import SlopeProfile
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, Command, FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.actuators import limit_command
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.safety_monitor import MonitorMemory

DEFAULT, TWO_S, ONE_AND_A_HALF_S = "default", "2 s", "1.5 s"
HEADWAYS: Mapping[str, Mapping[str, float]] = {
    DEFAULT: {},
    TWO_S: {"gap.desired_time_headway_s": 1.7},
    ONE_AND_A_HALF_S: {"gap.desired_time_headway_s": 1.15, "gap.time_headway_s": 1.0},
}
AUTHENTICATED, OPEN, NO_RADIO = "authenticated", "not authenticated", "none"
RADIOS = (AUTHENTICATED, OPEN, NO_RADIO)
SEEDS = (11, 12, 13)
AFTER_S, HELD_S = 21.0, 8.0
"""Time that is driven after the event, and for which the vehicle ahead keeps its speed before its drive."""
REACTION_S, SAMPLED_S = 1.0, 0.1
"""Of the bound; and of a range sensor that is sound again, its period."""
LOSS_M_S, COMFORT_M_S2 = 8.0, -2.05
"""What messages may cost: speed where they are not authenticated, deceleration with a published friction."""
LEAD_M_S2 = 9.0
STARTS_M_S2, STARTS_S = 1.2, 2.0
_STEPS_S = round(1.0 / STEP_S)


@cache
def _parameters(headway: str, mass: float = 1.0) -> ModelParameters:
    values = load_parameters("paper_calibrated", HEADWAYS[headway]).values
    return replace(values, body=replace(values.body, mass_kg=mass * values.body.mass_kg))


@cache
def _controller(headway: str) -> MpcController:
    """Return one whose solver is shared."""
    return MpcController(_parameters(headway), ControllerOptions())


@cache
def _route(drive: str) -> Route:
    return build_route(drive, "flat", initial_gap_m=_parameters(DEFAULT).gap.initial_gap_m)


def undisturbed(
    random: np.random.Generator, drive: str, initial_gap_m: float
) -> tuple[Motion, float]:
    """Return a part of a drive, from standstill, and an instant in it at which something happens."""
    route = _route(drive)
    speeds = np.clip(route.leader.speeds_at(np.arange(0.0, route.duration_s, STEP_S)), 0.0, 36.0)
    part = 30 * _STEPS_S
    first = int(random.choice(np.flatnonzero(speeds[:-part] > 5.0)))
    start = speeds[first]
    at = round(STARTS_S * _STEPS_S)
    rise = np.arange(0.0, start, STARTS_M_S2 * STEP_S)
    whole = np.concatenate(
        (np.zeros(at), rise, np.full(round(HELD_S * _STEPS_S), start), speeds[first : first + part])
    )
    event = whole.size - part + int(random.integers(2 * _STEPS_S, part // 2))
    held = np.full(round((AFTER_S + 15.0) * _STEPS_S), whole[event + 3 * _STEPS_S])
    whole = np.concatenate((whole[: event + 3 * _STEPS_S], held))
    if random.random() < 0.5:  # it slows before, which closes the gap
        factors = np.ones(whole.size)
        slower = 1.0 - float(random.uniform(0.1, 0.5))
        factors[event - 600 : event] = np.linspace(1.0, slower, 600)
        factors[event:] = slower
        whole = whole * factors
    return Motion.of(initial_gap_m, whole), event * STEP_S


class _World:
    """The vehicle ahead as it is, and what it predicts."""

    def __init__(self, draw: Draw, drive: Motion) -> None:
        self.true, self._draw, self._drive = draw.true, draw, drive

    def leader_at(self, time_ns: int) -> LeaderState:
        time_s = time_ns / NS_PER_S
        return LeaderState(time_s, *map(float, self.true.at(time_s)))

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        now_s = float(times_s[0])
        if self._draw.is_announced:
            return LeaderPreview(times_s, *self.true.at(times_s))
        if now_s < self._draw.onset_s:
            return LeaderPreview(times_s, *self._drive.at(times_s))
        position_m, speed_m_s = self.true.at(now_s)
        ahead_m = position_m + speed_m_s * (times_s - now_s)
        return LeaderPreview(times_s, ahead_m, np.full(times_s.size, speed_m_s))

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        return LeaderPreview(times_s, *self.true.at(times_s))


class _Vehicle(RecordedPlant):
    """With what a draw does to car and world."""

    draw: Draw
    world: _World
    worn: float = 0.0
    own: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        for at_s, event in self.draw.events:
            if state.time_s <= at_s < state.time_s + duration_s:
                own_m = state.position_m + state.speed_m_s * (at_s - state.time_s)
                self.world.true = event(self.world.true, own_m, state.speed_m_s)
        restarts_s = self.draw.process.get("monitor_s", math.inf)
        if state.time_s <= restarts_s < state.time_s + duration_s:
            self.resume(MonitorMemory())
        car = self.draw.car
        strength = car.get("strength", 1.0)
        self.brake_strength = max(strength - car.get("fades", 0.0) * self.worn, min(strength, 0.4))
        report = limit_command(command, state, self.parameters.limits, duration_s)
        self.own = (
            state.time_s, state.position_m, state.speed_m_s, report.actuated.acceleration_m_s2
        )  # fmt: skip
        step = super().advance(state, command, duration_s)
        braked = max(-step.state.acceleration_m_s2 - 1.0, 0.0)
        self.worn += 0.01 * braked * state.speed_m_s * duration_s
        return step

    def own_position_m(self, time_s: float) -> float:
        """Return where the vehicle is in the present interval if the monitor does not act."""
        start_s, position_m, speed_m_s, acceleration_m_s2 = self.own
        elapsed_s = time_s - start_s
        if acceleration_m_s2 < 0.0:
            elapsed_s = min(elapsed_s, speed_m_s / -acceleration_m_s2)
        return position_m + elapsed_s * (speed_m_s + 0.5 * acceleration_m_s2 * elapsed_s)


class _Sensors:
    """What is measured and heard."""

    def __init__(self, draw: Draw, vehicle: _Vehicle) -> None:
        self._draw, self._vehicle = draw, vehicle

    def disturb(self, measured: Measurements) -> tuple[LeaderState, Measurements]:
        state, true, draw = measured.state, measured.leader, self._draw
        if state is None or true is None:
            raise ScenarioError("measurements lack state or leader; allowed: complete ones")
        leader: LeaderState | None = true
        preview = measured.preview
        if draw.sensor is not None:
            given = state.time_s, true.position_m, true.speed_m_s, state.position_m
            seen = draw.sensor(*given)
            leader = None if seen is None else LeaderState(state.time_s, *map(float, seen))
        if draw.radio is not None:
            preview = draw.radio(state.time_s, preview)
        fault = "" if leader is not None else "no measurement of the leader received"
        return true, replace(measured, leader=leader, preview=preview, fault=fault)

    def sampled(self, own: LeaderPreview, _: float) -> LeaderPreview | None:
        if self._draw.sensor is None:
            return own
        rows = []
        columns = own.times_s, own.positions_m, own.speeds_m_s
        for time_s, position_m, speed_m_s in zip(*map(np.ndarray.tolist, columns), strict=True):
            own_m = self._vehicle.own_position_m(time_s)
            seen = self._draw.sensor(time_s, position_m, speed_m_s, own_m)
            if seen is not None:
                rows.append((time_s, *map(float, seen)))
        if rows:
            return LeaderPreview(*np.array(rows).T)
        return LeaderPreview.empty() if self._draw.is_empty else None


class _Process:
    """The controller with what a draw does to its process."""

    def __init__(self, inner: MpcController, draw: Draw) -> None:
        self._inner, self._draw, self.options = inner, draw, inner.options
        inner.memory = self._fresh = ControllerMemory()
        self._made, self._is_restarted = list[Decision](), False

    def decide(self, measured: Measurements) -> Decision:
        state, process, published = measured.state, self._draw.process, self._draw.published
        time_s = 0.0 if state is None else state.time_s
        if not self._is_restarted and time_s >= process.get("controller_s", math.inf):
            self._inner.memory, self._is_restarted = self._fresh, True
        if published is not None and time_s >= published[0]:
            self._inner.lead.friction = published[1]
        self._made.append(self._inner.decide(measured))
        return self._made[max(len(self._made) - 1 - int(process.get("late_ticks", 0)), 0)]


@dataclass(frozen=True)
class Setting:
    """How a family is driven."""

    family: str
    headway: str
    radio: str

    @property
    def name(self) -> str:
        """For reports."""
        return f"{self.family}, {self.headway}, radio {self.radio}"


def trial(
    setting: Setting,
    drive: str,
    seed: tuple[int, ...],
    families: Mapping[str, Family] = FAMILIES,
) -> dict[str, Any]:
    """Drive one trial of a family and return its row."""
    random = np.random.default_rng([*seed, zlib.crc32(setting.family.encode())])
    values = _parameters(setting.headway)
    motion, at_s = undisturbed(random, drive, values.gap.initial_gap_m)
    draw = families[setting.family](random, motion, at_s, LEAD_M_S2)
    car = draw.car
    slope_rad, friction = math.atan(car.get("slope", 0.0)), car.get("friction", 0.0)
    if friction:
        at_most = tyre_deceleration_m_s2(friction, slope_rad)
        speeds = _softened(motion.speeds_m_s * min(1.0, 0.4 + 2.0 * friction), 0.8 * at_most)
        motion = Motion.of(values.gap.initial_gap_m, speeds)
        draw = families[setting.family](random, motion, at_s, at_most)
        draw = replace(draw, car=car)
    duration_s = math.ceil(at_s + AFTER_S)
    route = replace(_route(drive), duration_s=float(duration_s))
    route = replace(route, slope=SlopeProfile(np.zeros(1), np.array([slope_rad])))
    is_authenticated = setting.radio != OPEN
    vehicle = _Vehicle(
        _parameters(setting.headway, car.get("mass", 1.0)),
        route.slope.slope_at,
        safety=SafetyMonitorSettings(authenticated_radio=is_authenticated),
    )
    vehicle.road_friction = friction
    vehicle.draw, vehicle.world = draw, _World(draw, motion)
    options = ControllerOptions(radio=RadioSettings(authenticated_radio=is_authenticated))
    controller = MpcController(values, options, _controller(setting.headway).backend)
    mode = PreviewMode.NONE if setting.radio == NO_RADIO else PreviewMode.FULL
    run_closed_loop(
        route,
        vehicle,
        _Process(controller, draw),
        PreviewSettings(preview_mode=mode),
        faults=_Sensors(draw, vehicle),
        leader=vehicle.world,
    )
    return {**vars(setting), "at_s": at_s, "drawn": draw.drawn, **_judged(draw, vehicle)}


def _softened(speeds: FloatArray, deceleration_m_s2: float) -> FloatArray:
    """Return speeds that fall no faster than a road permits."""
    found = speeds.copy()
    for index in range(1, found.size):
        found[index] = max(found[index], found[index - 1] - deceleration_m_s2 * STEP_S)
    return found


def _judged(draw: Draw, vehicle: _Vehicle) -> dict[str, Any]:
    times_s, own_m, own_m_s, own_m_s2 = vehicle.motion()
    ahead_m, ahead_m_s = vehicle.world.true.at(times_s)
    gaps_m = ahead_m - own_m
    onset = int(np.searchsorted(times_s, draw.onset_s))
    touching = np.flatnonzero(gaps_m <= 0.0)
    row: dict[str, Any] = {
        "smallest_gap_m": float(gaps_m.min()),
        "onset_m_s": float(own_m_s[onset]),
        "hardest_m_s2": float(own_m_s2[onset:].min()),
        "lost_m_s": float(min(own_m_s[onset], ahead_m_s[onset:].min()) - own_m_s[onset:].min()),
        "collided": bool(touching.size),
        "impact_m_s": 0.0,
        "bound_m": math.nan,
        "blind_bound_m": math.nan,
    }
    if touching.size:
        first = int(touching[0])
        row["impact_m_s"] = float(max(own_m_s[first] - ahead_m_s[first], 0.0))
        row["bound_m"] = _bound_m(draw, vehicle, onset, REACTION_S)
        if draw.returns_s is not None:
            returns = int(np.searchsorted(times_s, draw.returns_s))
            at_best_m = _bound_m(draw, vehicle, returns, SAMPLED_S)
            row["blind_bound_m"] = min(at_best_m, float(gaps_m[: returns + 1].min()))
    return row


def _bound_m(draw: Draw, vehicle: _Vehicle, onset: int, reaction_s: float) -> float:
    """Return the smallest gap of stated brakes that act after a reaction and their delay."""
    _, own_m, own_m_s, own_m_s2 = vehicle.motion()
    brakes, car = vehicle.parameters.brakes, draw.car
    slope_rad = math.atan(car.get("slope", 0.0))
    least = min(car.get("strength", 1.0), 0.4 if car.get("fades") else 1.0)
    most_m_s2 = least * brakes.max_deceleration_m_s2
    if car.get("friction"):
        most_m_s2 = min(most_m_s2, tyre_deceleration_m_s2(car["friction"], slope_rad))
    most_m_s2 = max(most_m_s2 + GRAVITY_M_S2 * math.sin(slope_rad), 0.3)
    now, start_s = slice(onset, onset + 1), STEP_S * onset

    def ahead_m(elapsed_s: float) -> FloatArray:
        return np.atleast_1d(vehicle.world.true.at(start_s + elapsed_s)[0])

    hardest = replace(brakes, max_deceleration_m_s2=most_m_s2)
    gaps_m, _ = emergency_stops(
        ahead_m, own_m[now], own_m_s[now], own_m_s2[now], hardest, max(reaction_s, 0.0)
    )
    return float(gaps_m[0])


def trials(setting: Setting, drives: list[str], count: int, seed: int) -> pd.DataFrame:
    """Return a row per trial of a family; the drives take turns by chance."""
    rows = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        rows.append(trial(setting, str(random.choice(drives)), (seed, number)))
    return pd.DataFrame(rows)


def family_outcomes(
    session: Session,
    drives: list[str],
    count: int,
    seeds: tuple[int, ...],
    headways: tuple[str, ...],
    radios: tuple[str, ...],
) -> pd.DataFrame:
    """Return the trials of all families.

    Args:
        drives: cycles and paths of measured drives.
        count: trials of each seed.
        seeds: of the draws.
    """
    settings = [
        Setting(family, headway, radio)
        for family in FAMILIES
        for headway in headways
        for radio in radios
        if radio != NO_RADIO or "radio" not in family
    ]
    pairs = [(setting, seed) for setting in settings for seed in seeds]
    calls = [
        {"setting": setting, "drives": drives, "count": count, "seed": seed}
        for setting, seed in pairs
    ]
    names = [f"{setting.name}, seed {seed}" for setting, seed in pairs]
    found = [table for table in session.compute(trials, calls, names) if table is not None]
    return pd.concat(found, ignore_index=True)


def _marked(table: pd.DataFrame) -> pd.DataFrame:
    """Return trials with what of a collision is avoidable, and not explained by a blind sensor."""
    avoidable = table.collided & (table.bound_m > 0.0)
    explained = table.blind_bound_m <= 0.0
    return table.assign(trials=1, avoidable=avoidable, unexplained=avoidable & ~explained)


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per family and radio: trials, collisions, and what of them must not be."""
    sums = (
        _marked(table)
        .groupby(["family", "radio"], sort=False)
        .agg(
            trials=("trials", "sum"),
            collided=("collided", "sum"),
            avoidable=("avoidable", "sum"),
            unexplained=("unexplained", "sum"),
            impact_m_s=("impact_m_s", "max"),
            lost_m_s=("lost_m_s", "max"),
            hardest_m_s2=("hardest_m_s2", "min"),
        )
    )
    # A loss of less than 0.05 m/s has no sign.
    sums["lost_m_s"] = sums.lost_m_s.round(1) + 0.0
    return sums.reset_index()


def blind_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per time for which a sensor is blind, and headway: avoidable collisions of trials.

    Without messages, also by how much the gap is too short for any rule that acts when the sensor is sound
    again: median and largest, and as a time at the own speed.
    """
    marked = _marked(table)
    blind = marked[marked.drawn.map(lambda drawn: "blind_s" in drawn) & (marked.family != TWO)]
    blind = blind.assign(blind_s=blind.drawn.map(lambda drawn: drawn["blind_s"]))
    rows = []
    for (blind_s, headway), scene in blind.groupby(["blind_s", "headway"], sort=False):
        row: dict[str, Any] = {"blind_s": blind_s, "headway": headway}
        for radio in RADIOS:
            found = scene[scene.radio == radio]
            row[radio] = f"{found.avoidable.sum()} of {len(found)}" if len(found) else NO_VALUE
        alone = scene[(scene.radio == NO_RADIO) & scene.avoidable]
        short_m = -alone.blind_bound_m
        row |= {"median_m": short_m.median(), "largest_m": short_m.max()}
        row["largest_s"] = (short_m / alone.onset_m_s).max()
        rows.append(row)
    return pd.DataFrame(rows).sort_values("blind_s", kind="stable")


def left_over(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return collisions that are avoidable with authenticated messages, or not explained."""
    marked = _marked(table)
    kept = marked[marked.unexplained | (marked.avoidable & (marked.radio == AUTHENTICATED))]
    return [
        {
            **row._asdict(),
            "short_m": -row.smallest_gap_m,
            "what": ", ".join(_shown(*item) for item in row.drawn.items()),
        }
        for row in kept.itertuples()
    ]


def _shown(name: str, value: float | str) -> str:
    return f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"


def broken(table: pd.DataFrame) -> list[str]:
    """Return what did not hold, one line per family and radio.

    A range sensor alone that is blind, or wrong in scale, is not held against it.
    """
    lines = []
    for row in summary(table).itertuples():
        where = f"{row.family}, messages {row.radio}"
        is_alone = row.radio != AUTHENTICATED and row.family in OF_SENSOR_ALONE
        if row.family == PUBLISHED and row.hardest_m_s2 < COMFORT_M_S2:
            lines.append(f"{where}: a message brakes with {-row.hardest_m_s2:.1f} m/s^2")
        if row.family == LIE_OF_NOW and row.radio == OPEN and row.lost_m_s > LOSS_M_S:
            lines.append(f"{where}: {row.lost_m_s:.1f} m/s lost; allowed: {LOSS_M_S:g} m/s")
        if row.avoidable and not is_alone:
            lines.append(f"{where}: {row.avoidable} avoidable collisions")
    return lines

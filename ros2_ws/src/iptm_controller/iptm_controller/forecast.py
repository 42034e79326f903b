"""Forecast of the leader's motion for the optimiser: measured past, predicted future, and its quality.

A preview is used only if it is well formed and recent enough; beyond its end the leader keeps its last speed.
It is trusted as far as its bounds allow, and up to the horizon that earlier previews justify. From
there on the plan follows the expected motion and keeps its braking reserve. Bounds hold back what a preview
promises beyond the measured motion; of an up-to-date leader they ask for no more distance than without a
preview. Without a preview the leader is extrapolated: its measured acceleration decays. Which of these holds,
and why, is part of the result.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from iptm_controller.lead_check import (
    EXTRAPOLATED_NODES,
    LARGEST_SPEED_ERROR_M_S,
)
from iptm_controller.plan_data import CMotion, keep_motion, motion_of
from iptm_controller.preview_trust import (
    LONGEST_LEAD_S,
    ROUGH_M2_S4,
    SMOOTHED_TICKS,
    FusionMemory,
    Prediction,
    TrustMemory,
    lead_ticks,
)
from iptm_controller.tick_library import (
    DOUBLE,
    INT,
    POINTER,
)
from iptm_core.physics.ops import address, doubles
from iptm_core.state import (
    SPEED_AT_REST_M_S,
    TOLERANCE_S,
    FloatArray,
    LeaderPreview,
    LeaderState,
)

HISTORY_S = 3.0
MAX_LEADER_SPEED_M_S = 100.0
NEAR_S = 3.0
"""Where the trusted horizon is shorter than this, the measured motion limits the forecast up to here."""
UNKNOWN_ACCELERATION_M_S2 = 0.65
"""Without a preview the motion is extrapolated, and the gap limits hold for it. What lead vehicles may brake
meanwhile, 1.3 m in 2 s, is not allowed for then; bounds of a preview ask for the rest only."""


class PreviewQuality(IntEnum):
    """Quality of the preview."""

    FULL = 0
    """A valid preview, known over the whole horizon."""
    SHORT = 1
    """A valid preview that ends inside the horizon (constant speed beyond it), or is known up to there."""
    STALE = 2
    """The newest preview is too old; the measured motion is extrapolated."""
    MISSING = 3
    """No preview has been received; the measured motion is extrapolated."""
    INVALID = 4
    """The preview is malformed or contradicts the measurements; the measured motion is extrapolated."""
    DOUBTED = 5
    """A valid preview, but it or earlier ones were wrong; trusted up to a shorter horizon."""


@dataclass(frozen=True)
class LeaderForecast:
    """Motion of the leader around now.

    Attributes:
        motion: past and future, one piece.
        limiting: motion that the gap limits hold for: less its bounds as far as it is known, and at the first
            node in any case, but behind both expected and extrapolated motion only by what exceeds
            `UNKNOWN_ACCELERATION_M_S2`.
        quality: how the future is known.
        reason: one sentence, empty while the quality is full.
        age_s: age of the preview used, NaN without one.
        known_s: how far ahead the motion is known by a trusted preview; 0 where it is extrapolated.
    """

    motion: LeaderPreview
    limiting: LeaderPreview
    quality: PreviewQuality
    reason: str
    age_s: float
    known_s: float


def preview_fault(preview: LeaderPreview) -> str:
    """Return the fault of a preview in length, order, finiteness or plausibility, empty for none."""
    times, positions, speeds = preview.times_s, preview.positions_m, preview.speeds_m_s
    sizes = (times.size, positions.size, speeds.size)
    if len(set(sizes)) != 1:
        return f"preview has {sizes} times, positions and speeds; allowed: equal numbers"
    for label, values in (("time", times), ("position", positions), ("speed", speeds)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = _first(~finite)
            return f"preview {label} is {values[bad]} at node {bad}; allowed: finite values"
    with np.errstate(over="ignore"):
        passed_s, moved_m = times[1:] - times[:-1], positions[1:] - positions[:-1]
        halts, backwards = passed_s <= 0.0, moved_m < SPEED_AT_REST_M_S * np.maximum(passed_s, 1.0)
        leaps = moved_m > 1.0 + MAX_LEADER_SPEED_M_S * passed_s
    if halts.any():
        return f"preview times do not increase after node {_first(halts)}"
    if backwards.any():
        return f"preview positions move backwards after node {_first(backwards)}"
    if leaps.any():
        return (
            f"preview positions leap after node {_first(leaps)}; "
            f"allowed: {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    if speeds.size and not (
        speeds.min() >= SPEED_AT_REST_M_S and speeds.max() <= MAX_LEADER_SPEED_M_S
    ):
        return (
            f"preview speed is {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"allowed: {SPEED_AT_REST_M_S:g} to {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    return _bounds_fault(preview)


def _bounds_fault(preview: LeaderPreview) -> str:
    bounds = preview.bounds_m
    if bounds.size not in {0, preview.times_s.size}:
        return f"preview has {bounds.size} bounds; allowed: 0 or {preview.times_s.size}"
    if bounds.size and not (bounds.min() >= 0.0 and bounds.max() < np.inf):
        return f"preview bound is {bounds.min():g} to {bounds.max():g} m; allowed: finite values from 0 m"
    return ""


def doubted(trusted_s: float) -> str:
    """Return the reason of a shorter horizon."""
    return f"previews were wrong; trusted for {trusted_s:g} s"


def _first(flags: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(flags)[0])


def assessed(
    leader: LeaderState, preview: LeaderPreview, max_age_s: float, horizon_s: float
) -> tuple[PreviewQuality, str]:
    """Return the quality of a preview without regard to earlier ones, and the reason, empty if full."""
    if preview.times_s.size == 0:
        return PreviewQuality.MISSING, "no preview of the leader received yet"
    fault = preview_fault(preview)
    if fault:
        return PreviewQuality.INVALID, fault
    age_s = leader.time_s - preview.generated_at_s
    if age_s > max_age_s:
        reason = f"preview is {age_s:.1f} s old; allowed: up to {max_age_s:g} s"
        return PreviewQuality.STALE, reason
    if age_s < -TOLERANCE_S:
        return PreviewQuality.INVALID, f"preview was generated {-age_s:.3f} s in the future"
    last_s = float(preview.times_s[-1])
    if last_s <= leader.time_s:
        return PreviewQuality.STALE, f"preview ended {leader.time_s - last_s:.1f} s ago"
    predicted_m_s = float(np.interp(leader.time_s, preview.times_s, preview.speeds_m_s))
    if abs(predicted_m_s - leader.speed_m_s) > LARGEST_SPEED_ERROR_M_S:
        return PreviewQuality.INVALID, (
            f"preview is {predicted_m_s - leader.speed_m_s:+.1f} m/s off the measured speed, "
            f"more than {LARGEST_SPEED_ERROR_M_S:g} m/s"
        )
    until_s = min(last_s, preview.known_until_s)
    if until_s < leader.time_s + horizon_s - TOLERANCE_S:
        verb = "is known for" if until_s < last_s else "covers"
        ahead_s = max(until_s - leader.time_s, 0.0)
        return (
            PreviewQuality.SHORT,
            f"preview {verb} {ahead_s:.1f} s of a {horizon_s:g} s horizon",
        )
    return PreviewQuality.FULL, ""


ForecastMemory = tuple[tuple[LeaderState, ...], FusionMemory, TrustMemory]
"""Leader measured in the last seconds, oldest first; average of the previews, and trust in them."""


_COLUMNS = ("fused_times_s", "fused_speeds_m_s", "averaged_m_s", "weights")
_WORK = 5
_QUALITIES = tuple(PreviewQuality)


class _Forecaster(ctypes.Structure):
    _fields_ = (
        *((name, DOUBLE) for name in ("tick_s", "horizon_s", "max_age_s")),
        *((name, DOUBLE) for name in ("decay_s", "braking_decay_s")),
        ("leads", INT),
        ("lead_ticks", INT * LONGEST_LEAD_S),
        ("past_room", INT),
        ("preview_room", INT),
    )


class _Memory(ctypes.Structure):
    _fields_ = (
        *((name, INT) for name in ("past", "errors", "has_predicted", "is_doubted")),
        *((name, INT) for name in ("is_unproved", "fused", "is_averaged")),
        *((name, DOUBLE) for name in ("newest_tick", "last_error_tick", "trusted_s")),
        ("roughness_m2_s4", DOUBLE),
        ("errors_m_s", DOUBLE * (SMOOTHED_TICKS * LONGEST_LEAD_S)),
        *((name, POINTER) for name in ("leaders", "predictions", *_COLUMNS, "work")),
    )


class _Forecast(ctypes.Structure):
    _fields_ = (
        *(
            (name, POINTER)
            for name in ("times", "positions", "speeds", "limiting", "limiting_speeds")
        ),
        *((name, INT) for name in ("nodes", "has_limiting", "quality")),
        *((name, DOUBLE) for name in ("known_s", "trusted_s")),
    )


def past_room(tick_s: float) -> int:
    """Return the leaders that a memory has room for."""
    return round(HISTORY_S / tick_s) + 2


class LeaderForecaster:
    """Combines the measured leader with previews; reasons are put into words in Python."""

    def __init__(
        self,
        library: ctypes.PyDLL,
        horizon_s: float,
        max_age_s: float,
        tick_s: float,
        decay_s: float,
        braking_decay_s: float,
    ) -> None:
        """Set up a forecaster that has not measured a leader.

        Args:
            horizon_s: time that a full preview covers.
            decay_s: time constant with which the leader's measured acceleration decays where nothing is
                predicted.
            braking_decay_s: the same where it brakes.
        """
        self._horizon_s, self._max_age_s = horizon_s, max_age_s
        self._c_memory = _Memory()
        leads = lead_ticks(tick_s)
        self._numbers = _Forecaster(
            tick_s,
            horizon_s,
            max_age_s,
            decay_s,
            braking_decay_s,
            len(leads),
            (INT * LONGEST_LEAD_S)(*leads),
        )
        self._predictions = np.zeros((leads[-1] + 1, 2 + len(leads)))
        self._c_memory.predictions = address(self._predictions)
        self._leaders, self._columns = np.empty((0, 3)), np.empty((len(_COLUMNS) + _WORK, 0))
        self._make_room(past_room(tick_s), 128)
        self._forecast, self._leader_at = library.iptm_forecast_leader, library.iptm_leader_at
        self._leader, self._write_leader = doubles(3)
        self._given = ctypes.byref(self._numbers), ctypes.byref(self._c_memory)

    def _make_room(self, past: int, preview: int) -> None:
        """Let the memory have room for leaders and nodes of a preview."""
        if past > self._numbers.past_room:
            kept, self._leaders = self._leaders, np.empty((past, 3))
            self._leaders[: len(kept)] = kept
            self._numbers.past_room = len(self._leaders)
            self._c_memory.leaders = address(self._leaders)
        if preview > self._numbers.preview_room:
            columns = self._columns
            self._columns = np.empty((len(columns), preview))
            self._columns[:, : columns.shape[1]] = columns
            self._numbers.preview_room = preview
            for name, column in zip((*_COLUMNS, "work"), self._columns, strict=False):
                setattr(self._c_memory, name, address(column))

    @property
    def memory(self) -> ForecastMemory:
        """State carried from tick to tick."""
        return self.kept_memory()()

    @memory.setter
    def memory(self, memory: ForecastMemory) -> None:
        past, fusion, trust = memory
        c, leads = self._c_memory, self._numbers.leads
        self._make_room(len(past), 0 if fusion.preview is None else fusion.preview.times_s.size)
        for row, each in zip(self._leaders, past, strict=False):
            row[:] = each.time_s, each.position_m, each.speed_m_s
        c.past = len(past)
        c.roughness_m2_s4, c.is_averaged = fusion.roughness_m2_s4, fusion.speeds_m_s is not None
        c.fused = 0
        if fusion.preview is not None:
            columns = [fusion.preview.times_s, fusion.preview.speeds_m_s]
            columns += [each for each in (fusion.speeds_m_s, fusion.weights) if each is not None]
            c.fused = columns[0].size
            self._columns[: len(columns), : c.fused] = columns
        self._predictions[:] = 0.0
        for entry in trust.predictions:
            row = self._predictions[entry.tick % len(self._predictions)]
            row[:] = entry.tick + 1.0, entry.speed_m_s, *entry.speeds_m_s
            c.newest_tick = entry.tick
        c.has_predicted = bool(trust.predictions)
        c.errors = len(trust.errors) // leads
        for tick in range(c.errors):
            c.errors_m_s[tick * LONGEST_LEAD_S : tick * LONGEST_LEAD_S + leads] = trust.errors[
                tick * leads : (tick + 1) * leads
            ]
        c.is_doubted, c.is_unproved = not math.isinf(trust.horizon_s), not trust.proved
        c.trusted_s, c.last_error_tick = trust.horizon_s, trust.last_error_tick

    def kept_memory(self) -> Callable[[], ForecastMemory]:
        """Return what builds the memory of now, whenever it is called."""
        c, rows = _Memory.from_buffer_copy(self._c_memory), self._predictions.copy()
        columns = self._columns[: len(_COLUMNS), : c.fused].copy()
        return partial(self._built, c, self._leaders[: c.past].copy(), columns, rows)

    def _built(
        self, c: _Memory, leaders: FloatArray, columns: FloatArray, predictions: FloatArray
    ) -> ForecastMemory:
        """Return the memory from copies of its arrays."""
        leads = self._numbers.leads
        times, received, averaged, weights = columns
        preview = LeaderPreview(times, np.zeros(c.fused), received) if c.fused else None
        average = (averaged, weights) if c.is_averaged else (None, None)
        oldest = c.newest_tick + 1.0 - (len(predictions) - 1)
        rows = sorted(row for row in predictions.tolist() if row[0] >= max(oldest, 1.0))
        errors = (
            c.errors_m_s[tick * LONGEST_LEAD_S : tick * LONGEST_LEAD_S + leads]
            for tick in range(c.errors)
        )
        trust = TrustMemory(
            tuple(Prediction(int(row[0]) - 1, row[1], tuple(row[2:])) for row in rows),
            tuple(value for each in errors for value in each),
            c.trusted_s if c.is_doubted else math.inf,
            int(c.last_error_tick),
            not c.is_unproved,
        )
        past = tuple(LeaderState(*row) for row in leaders.tolist())
        return past, FusionMemory(preview, c.roughness_m2_s4, *average), trust

    @property
    def noise(self) -> str:
        """How rough the previews are, empty if they pass unchanged."""
        found = self._c_memory.roughness_m2_s4
        return FusionMemory(roughness_m2_s4=found).noise if found >= ROUGH_M2_S4 else ""

    def leader_at(self, time_s: float, leader: LeaderState | None) -> LeaderState | None:
        """Return a measured leader as extrapolated to a later instant; as measured for the same one."""
        if leader is None or time_s <= leader.time_s:
            return leader
        self._write_leader(leader.time_s, leader.position_m, leader.speed_m_s)
        later = self._leader_at(*self._given, self._leader, time_s)
        return LeaderState(later.time_s, later.position_m, later.speed_m_s)

    def forecast(self, leader: LeaderState, preview: LeaderPreview) -> LeaderForecast:
        """Combine the measured leader with a preview.

        The prediction is shifted so that it starts at the measured position: a late or noisy preview
        must not move the leader that the range sensor sees.
        """
        size, past = preview.times_s.size, self._c_memory.past + 1
        if past > self._numbers.past_room or size > self._numbers.preview_room:
            self._make_room(2 * past, size)
        room = past + max(size + 1, EXTRAPOLATED_NODES)
        columns: FloatArray = np.empty((5, room))
        first, row = address(columns), columns.itemsize * room
        places = range(first, first + 5 * row, row)
        found = _Forecast(*places)
        self._write_leader(leader.time_s, leader.position_m, leader.speed_m_s)
        received = ctypes.byref(motion_of(preview))
        self._forecast(*self._given, self._leader, received, ctypes.byref(found))
        nodes = found.nodes
        motion = limiting = LeaderPreview(*columns[:3, :nodes])
        keep_motion(motion, CMotion(nodes, *places[:3]))
        if found.has_limiting:
            limiting = LeaderPreview(motion.times_s, *columns[3:, :nodes])
            keep_motion(limiting, CMotion(nodes, places[0], *places[3:]))
        quality, reason = _QUALITIES[found.quality], ""
        if quality is PreviewQuality.DOUBTED:
            reason = doubted(found.trusted_s)
        elif quality is not PreviewQuality.FULL:
            _, reason = assessed(leader, preview, self._max_age_s, self._horizon_s)
        age_s = leader.time_s - preview.times_s.item(0) if size else math.nan
        return LeaderForecast(motion, limiting, quality, reason, age_s, found.known_s)

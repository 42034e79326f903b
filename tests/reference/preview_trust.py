"""Trust in previews and their fusion in Python, to the bits of ``c/forecast.c``."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np

from iptm_controller.preview_trust import (
    ANOTHER_PLAN_M_S,
    CREDITED_LEAD_S,
    CREDITED_SLOWDOWN_M_S,
    ERROR_GROWTH_S,
    FORGETTING_PER_S,
    LEAST_VARIANCE,
    MEAN_GROWTH_M_S2,
    MEAN_TOLERANCE_M_S,
    PROBATION_S,
    SINGLE_GROWTH_M_S2,
    SINGLE_TOLERANCE_M_S,
    SMOOTHED_TICKS,
    FusionMemory,
    Prediction,
    TrustMemory,
    lead_ticks,
)
from iptm_core.frozen import replace
from iptm_core.state import ROUNDING_S, FloatArray, LeaderPreview, LeaderState


class PreviewTrust:
    """Trusted horizon of the previews of one lead vehicle.

    Only optimistic errors count, those in which the lead vehicle is slower than predicted. Previews are
    trusted until the first error beyond the tolerance; from then on up to the lead times below that error.
    Full trust returns after a time without such errors, and not before a slow-down has been predicted
    correctly: a source that always predicts constant speed is right for as long as nothing happens.

    Attributes:
        horizon_s: lead time up to which previews are trusted, infinite for the whole preview.
        lead_ticks: at which predictions are compared, in ticks.
        lead_times_s: the same in seconds, shape (n,).
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self.lead_ticks = lead_ticks(tick_s)
        lead_times_s = [lead * tick_s for lead in self.lead_ticks]
        self.lead_times_s = np.array(lead_times_s)
        self._single_m_s = _tolerances(SINGLE_TOLERANCE_M_S, SINGLE_GROWTH_M_S2, lead_times_s)
        self._mean_m_s = _tolerances(MEAN_TOLERANCE_M_S, MEAN_GROWTH_M_S2, lead_times_s)
        self.memory = TrustMemory()

    @property
    def memory(self) -> TrustMemory:
        """State carried from tick to tick."""
        return TrustMemory(
            tuple(self._predictions.values()),
            tuple(value for errors in self._errors for value in errors),
            self.horizon_s,
            self._last_error_tick,
            self._proved,
        )

    @memory.setter
    def memory(self, memory: TrustMemory) -> None:
        count = len(self.lead_ticks)
        ends = range(count, len(memory.errors) + 1, count)
        self._predictions = {entry.tick: entry for entry in memory.predictions}
        self._errors: deque[tuple[float, ...]] = deque(
            (memory.errors[end - count : end] for end in ends), SMOOTHED_TICKS
        )
        self.horizon_s = memory.horizon_s
        self._last_error_tick = memory.last_error_tick
        self._proved = memory.proved

    @property
    def is_full(self) -> bool:
        """Whether the whole preview is trusted."""
        return math.isinf(self.horizon_s)

    def observe(self, leader: LeaderState) -> None:
        """Compare a measured lead vehicle with the predictions for this instant."""
        tick = round(leader.time_s / self._tick_s)
        if self._predictions and tick < next(reversed(self._predictions)):
            self.memory = TrustMemory()
        earlier = [self._predictions.get(tick - lead) for lead in self.lead_ticks]
        speed_m_s, excess_m_s = leader.speed_m_s, []
        for place, entry in enumerate(earlier):
            error = 0.0 if entry is None else entry.speeds_m_s[place] - speed_m_s
            excess_m_s.append(0.0 if math.isnan(error) else error)
        errors = tuple(excess_m_s)
        self._errors.append(errors)
        failed = self._first_failed(errors)
        if failed is not None:
            trusted_s = self.lead_ticks[failed - 1] * self._tick_s if failed else 0.0
            self.horizon_s = min(self.horizon_s, trusted_s)
            self._last_error_tick, self._proved = tick, False
        elif not self.is_full:
            self._proved = self._proved or self._proves(leader.speed_m_s, earlier, errors)
            if self._proved and (tick - self._last_error_tick) * self._tick_s >= PROBATION_S:
                self.horizon_s = math.inf

    def remember(
        self, leader: LeaderState, future: LeaderPreview, known_until_s: float = math.inf
    ) -> None:
        """Keep what a preview asserts for the lead times, to compare it later.

        Args:
            known_until_s: trip time up to which it is asserted; later motion is an expectation.
        """
        times_s = leader.time_s + self.lead_times_s
        speeds = np.interp(times_s, future.times_s, future.speeds_m_s, right=math.nan)
        speeds[times_s > known_until_s + ROUNDING_S] = math.nan
        self.keep(leader, tuple(speeds.tolist()))

    def keep(self, leader: LeaderState, speeds_m_s: tuple[float, ...]) -> None:
        """Keep speeds that are predicted for the lead times, NaN where nothing is asserted."""
        tick = round(leader.time_s / self._tick_s)
        self._predictions[tick] = Prediction(tick, leader.speed_m_s, speeds_m_s)
        while next(iter(self._predictions)) < tick - self.lead_ticks[-1]:
            del self._predictions[next(iter(self._predictions))]

    def _first_failed(self, errors: tuple[float, ...]) -> int | None:
        """Return the place of the shortest lead time with an error beyond a tolerance, None without one."""
        if max(errors) <= self._mean_m_s[0]:
            return None
        for place, error in enumerate(errors):
            mean = 0.0
            for each in self._errors:
                mean += max(each[place], -1.0)
            mean /= SMOOTHED_TICKS
            if error > self._single_m_s[place] or mean > self._mean_m_s[place]:
                return place
        return None

    def _proves(
        self, speed_m_s: float, earlier: Iterable[Prediction | None], errors: tuple[float, ...]
    ) -> bool:
        """Return whether a slow-down up to now was predicted in time."""
        cases = zip(earlier, errors, self.lead_times_s, self._mean_m_s, strict=True)
        for place, (entry, error, lead_s, tolerance) in enumerate(cases):
            if entry is None or lead_s < CREDITED_LEAD_S:
                continue
            slowed_m_s = entry.speed_m_s - speed_m_s
            predicted_m_s = entry.speed_m_s - entry.speeds_m_s[place]
            right = abs(error) < tolerance < slowed_m_s
            if right and predicted_m_s > CREDITED_SLOWDOWN_M_S:
                return True
        return False


def _tolerances(constant: float, growth: float, leads_s: Iterable[float]) -> tuple[float, ...]:
    return tuple(constant + growth * lead_s for lead_s in leads_s)


class PreviewFusion:
    """Passes consistent previews on, averages noisy ones."""

    def __init__(self) -> None:
        self.memory = FusionMemory()

    def fused(self, preview: LeaderPreview) -> LeaderPreview:
        """Return a preview, averaged with those received before if they are noisy.

        Args:
            preview: well formed, not empty. One that was received before is not counted again, a different
                one of the same instant replaces it, and an earlier one begins a new trip.
        """
        memory, before = self.memory, self.memory.preview
        if before is None or preview.generated_at_s < before.generated_at_s:
            self.memory = FusionMemory(preview)
        elif preview.generated_at_s > before.generated_at_s:
            self.memory = _updated(memory, before, preview)
        elif not _are_equal(before, preview):
            self.memory = FusionMemory(preview, memory.roughness_m2_s4)
        speeds = self.memory.speeds_m_s
        if speeds is None:
            return preview
        moved = np.cumsum(0.5 * np.diff(preview.times_s) * (speeds[1:] + speeds[:-1]))
        positions = preview.positions_m[0] + np.concatenate([[0.0], moved])
        return replace(preview, positions_m=positions, speeds_m_s=speeds)


def roughness_m2_s4(before: LeaderPreview, now: LeaderPreview) -> float:
    """Return the mean squared rate at which two previews differ, NaN with less than two common nodes."""
    common = _common(before, now)
    if common.stop - common.start < 2:
        return math.nan
    expected = np.interp(now.times_s[common], before.times_s, before.speeds_m_s)
    difference = now.speeds_m_s[common] - expected
    rates = np.diff(difference) / np.diff(now.times_s[common])
    squares: list[float] = np.cumsum(rates * rates).tolist()
    return squares[-1] / len(squares)


def _common(before: LeaderPreview, now: LeaderPreview) -> slice:
    """Return the nodes of a preview that lie within the one before."""
    ends_s = before.times_s[[0, -1]] + ROUNDING_S * np.array([-1, 1])
    first, last = np.searchsorted(now.times_s, ends_s).tolist()
    return slice(first, max(first, last))


def _updated(memory: FusionMemory, before: LeaderPreview, now: LeaderPreview) -> FusionMemory:
    """Return the memory after another preview."""
    differing_m2_s4 = roughness_m2_s4(before, now)
    elapsed_s = now.generated_at_s - before.generated_at_s
    kept = (1.0 - FORGETTING_PER_S) ** elapsed_s
    if math.isnan(differing_m2_s4):
        return FusionMemory(now, memory.roughness_m2_s4)
    rough = memory.roughness_m2_s4
    rough += (1.0 - kept) * (differing_m2_s4 - rough)
    begun = FusionMemory(now, rough)
    if not begun.is_noisy:
        return begun
    times, common = now.times_s, _common(before, now)
    earlier, weights = before.speeds_m_s, _weights(before)
    if memory.speeds_m_s is not None and memory.weights is not None:
        earlier, weights = memory.speeds_m_s, memory.weights
    expected = np.interp(times, before.times_s, earlier)
    innovation = (now.speeds_m_s - expected)[common]
    # Sums in the order of the nodes, which NumPy's own is not.
    squares = float(np.cumsum(innovation * innovation)[-1])
    if squares / innovation.size > ANOTHER_PLAN_M_S**2:
        return begun
    old = np.zeros(times.size)
    old[common] = kept * np.interp(times[common], before.times_s, weights)
    new = _weights(now)
    speeds = (old * expected + new * now.speeds_m_s) / (old + new)
    return replace(begun, speeds_m_s=speeds, weights=old + new)


def _are_equal(one: LeaderPreview, other: LeaderPreview) -> bool:
    return np.array_equal(one.times_s, other.times_s) and np.array_equal(
        one.speeds_m_s, other.speeds_m_s
    )


def _weights(preview: LeaderPreview) -> FloatArray:
    """Return the inverse variances of the speeds of one preview, 1 far ahead."""
    lead_s = np.maximum(preview.times_s - preview.generated_at_s, 0.0)
    exponents = (-2.0 * lead_s / ERROR_GROWTH_S).tolist()
    variances: FloatArray = -np.array([math.expm1(each) for each in exponents])
    return 1.0 / np.maximum(variances, LEAST_VARIANCE)

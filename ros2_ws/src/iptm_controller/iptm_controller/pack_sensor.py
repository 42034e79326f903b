"""One temperature sensor against its model, and the cooling against its command: what is carried of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from iptm_controller.measurements import PACK_RANGES

TOLERANCE_K = 2.5
"""Least difference from the model at which a sensor is rejected; noise raises it to at most twice as much."""
NOISE_FACTOR = 5.0
STUCK_K = 0.02
STUCK_STEPS = 5.0
"""A sensor is stuck when the model has moved by both, in K and in steps of the sensor, since it changed."""
RECOVERY_S = 10.0
APART_K = 6.0
"""Cells of one channel do not start a trip farther apart."""
START_S = 10.0
"""In which two sensors that are alike, and both unlike the model, show that the first values were wrong."""
CORRECTION_1_S = 0.05
EFFECT_W, EFFECT_SHARE, EFFECT_S = 300.0, 0.3, 20.0
"""Cooling of less than this share of an expected heat of at least so much, for so long, has no effect."""
FOLLOW_W, FOLLOW_SHARE, FOLLOW_S = 30.0, 0.3, 8.0
"""A compressor that draws less than this share of a command of at least so much does not follow it."""


def is_temperature(value_k: float) -> bool:
    """Return whether a cell or its coolant may have a temperature."""
    low, high = PACK_RANGES["cell_1_temperature_k"]
    return low <= value_k <= high


@dataclass(frozen=True)
class SensorMemory:
    """Of one temperature sensor.

    Attributes:
        model_k: temperature of the model, NaN before the first tick.
        value_k: last measured value.
        moved_k: distance that the model has moved since the value changed.
        step_k: smallest change of the value so far.
        noise_k2: mean square of the difference from the model.
        bad_s: time since it is not used, 0 while it is.
        sound_s: time for which a sensor that is not used has agreed with the model.
    """

    model_k: float = math.nan
    value_k: float = math.nan
    moved_k: float = 0.0
    step_k: float = 0.25
    noise_k2: float = 0.0
    bad_s: float = 0.0
    sound_s: float = 0.0

    def moved(self, by_k: float) -> SensorMemory:
        """Return the sensor with a model that has moved."""
        return replace(self, model_k=self.model_k + by_k, moved_k=self.moved_k + abs(by_k))

    def judged(self, value_k: float, elapsed_s: float) -> SensorMemory:
        """Return the sensor at a tick: whether it is used, from its value and the model."""
        apart_k = value_k - self.model_k
        noise_k = NOISE_FACTOR * math.sqrt(self.noise_k2)
        tolerance_k = min(max(TOLERANCE_K, noise_k), 2.0 * TOLERANCE_K)
        changed = value_k != self.value_k
        step_k, moved_k = self.step_k, self.moved_k
        if changed:
            moved_k = 0.0
            if math.isfinite(self.value_k) and math.isfinite(value_k):
                step_k = min(step_k, abs(value_k - self.value_k))
        is_stuck = moved_k > max(STUCK_K, STUCK_STEPS * step_k)
        is_wrong = is_stuck or not (is_temperature(value_k) and abs(apart_k) <= tolerance_k)
        sound_s = 0.0 if is_wrong else self.sound_s + elapsed_s
        bad_s = self.bad_s + elapsed_s if is_wrong or self.bad_s else 0.0
        if is_wrong:
            bad_s = max(bad_s, 1e-9)
        elif sound_s >= RECOVERY_S:
            bad_s = 0.0
        noise_k2 = self.noise_k2
        if not bad_s:
            noise_k2 += min(elapsed_s / 60.0, 1.0) * (apart_k * apart_k - noise_k2)
        return replace(
            self,
            value_k=value_k,
            moved_k=moved_k,
            step_k=step_k,
            noise_k2=noise_k2,
            bad_s=bad_s,
            sound_s=sound_s,
        )


@dataclass(frozen=True)
class CoolingMemory:
    """Of compressor, pump and fan.

    Attributes:
        without_effect_s: for how long cooling, or heating, has had no effect.
        unfollowed_s: for how long the compressor has not followed its command.
    """

    without_effect_s: float = 0.0
    unfollowed_s: float = 0.0

    @property
    def has_no_effect(self) -> bool:
        """Whether cooling has had no effect for long."""
        return self.without_effect_s > EFFECT_S

    @property
    def is_ignored(self) -> bool:
        """Whether the compressor has not followed its command for long."""
        return self.unfollowed_s > FOLLOW_S

    def after(
        self, elapsed_s: float, taken_w: float, expected_w: float, drawn_w: float, asked_w: float
    ) -> CoolingMemory:
        """Return the memory a tick later.

        Args:
            taken_w: heat that the coolant loses on its way round, negative where it is heated.
            expected_w: what it ought to lose at the power that is drawn.
            drawn_w: measured power of the compressor, negative of the heater.
            asked_w: its last command.
        """
        # Where little is asked for, nothing is shown: the times stay as they are.
        without_effect_s, unfollowed_s = self.without_effect_s, self.unfollowed_s
        if abs(expected_w) > EFFECT_W:
            fails = not taken_w / expected_w >= EFFECT_SHARE
            without_effect_s = without_effect_s + elapsed_s if fails else 0.0
        if abs(asked_w) > FOLLOW_W:
            ignored = drawn_w / asked_w < FOLLOW_SHARE
            unfollowed_s = unfollowed_s + elapsed_s if ignored else 0.0
        elif abs(drawn_w) > FOLLOW_W:
            unfollowed_s = 0.0  # it follows late
        return CoolingMemory(without_effect_s, unfollowed_s)


def are_alike(sensors: list[SensorMemory], measured_k: list[float]) -> bool:
    """Return whether both sensors contradict the model, but not each other."""
    possible = all(is_temperature(value_k) for value_k in measured_k)
    apart_k = abs(measured_k[0] - measured_k[1])
    return possible and all(sensor.bad_s for sensor in sensors) and apart_k <= APART_K


def corrected(
    sensors: list[SensorMemory], measured_k: list[float], offset_k: float, elapsed_s: float
) -> list[SensorMemory]:
    """Return the sensors with their models corrected: by its value, the other sensor, or the coolant."""
    gain = min(CORRECTION_1_S * elapsed_s, 1.0)
    apart_k = [
        value_k - sensor.model_k for sensor, value_k in zip(sensors, measured_k, strict=True)
    ]
    sound = [apart for sensor, apart in zip(sensors, apart_k, strict=True) if not sensor.bad_s]
    common_k = sound[0] if sound else offset_k
    return [
        replace(sensor, model_k=sensor.model_k + gain * (common_k if sensor.bad_s else apart))
        for sensor, apart in zip(sensors, apart_k, strict=True)
    ]

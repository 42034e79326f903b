"""What goes wrong between the leader's prediction and the host: delay, loss and error.

Every random number depends only on the seed, the purpose and the stamp, never on what was drawn
before: a run can be repeated, joined late or replayed from the middle with the same numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from itertools import accumulate

import numpy as np

from iptm_core.errors import ParameterError
from iptm_core.state import LeaderPreview
from iptm_v2x_bridge.source import NS_PER_S

TRANSMISSION_PERIOD_NS = NS_PER_S
"""One prediction is sent per sampling time; a slot of this length is lost or not as a whole."""
MAX_BURST = 1000
MAX_SEED = 2**63 - 1

_FIRST_SLOT = 2**32  # keeps the number of a slot positive for bursts that began before the trip


class _Purpose(IntEnum):
    """Keeps the random numbers of different purposes apart."""

    LOSS = 1
    NOISE = 2


@dataclass(frozen=True)
class Imperfections:
    """Quality of the link and of the prediction; the default is perfect.

    Attributes:
        latency_s: time from generation to reception.
        dropout_probability: share of the predictions that are lost, 0 to 1.
        dropout_burst: number of successive predictions that one disturbance takes away.
        noise_std_m_s: standard deviation of the speed error far from the generation.
        noise_correlation_s: time over which the speed error forgets its value.
        seed: of all random numbers.

    Raises:
        ParameterError: a value is out of range.
    """

    latency_s: float = 0.0
    dropout_probability: float = 0.0
    dropout_burst: int = 1
    noise_std_m_s: float = 0.0
    noise_correlation_s: float = 10.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("latency_s", self.latency_s, 0.0, 3600.0),
            ("dropout_probability", self.dropout_probability, 0.0, 1.0),
            ("dropout_burst", self.dropout_burst, 1, MAX_BURST),
            ("noise_std_m_s", self.noise_std_m_s, 0.0, 20.0),
            ("noise_correlation_s", self.noise_correlation_s, 0.1, 3600.0),
            ("seed", self.seed, 0, MAX_SEED),
        ):
            if not low <= value <= high:
                raise ParameterError(f"{name} is {value}; allowed: {low:g} to {high:g}")

    @property
    def latency_ns(self) -> int:
        """Delay in integer nanoseconds."""
        return round(self.latency_s * NS_PER_S)

    def is_lost(self, generated_ns: int) -> bool:
        """Return whether the prediction generated at an instant never arrives.

        Disturbances start independently in every slot and last `dropout_burst` slots; their rate is
        such that the share of lost predictions is `dropout_probability`, bursts or not.
        """
        if self.dropout_probability <= 0.0:
            return False
        if self.dropout_probability >= 1.0:
            return True
        start_probability = 1.0 - (1.0 - self.dropout_probability) ** (1.0 / self.dropout_burst)
        slot = generated_ns // TRANSMISSION_PERIOD_NS + _FIRST_SLOT
        return any(
            self._random(_Purpose.LOSS, slot - age).random() < start_probability
            for age in range(self.dropout_burst)
        )

    def distort(self, preview: LeaderPreview) -> LeaderPreview:
        """Return a prediction with a speed error, and with the positions that belong to it.

        The error starts at zero at the generation, where the leader knows its own speed, and grows
        to `noise_std_m_s` as a first-order process in time. Speeds stay at least zero, positions
        never decrease; without noise the prediction comes back untouched.
        """
        if self.noise_std_m_s <= 0.0 or preview.times_s.size < 2:
            return preview
        steps_s = np.diff(preview.times_s)
        decay = np.exp(-steps_s / self.noise_correlation_s)
        generated_ns = round(preview.generated_at_s * NS_PER_S)
        normal = self._random(_Purpose.NOISE, generated_ns).standard_normal(steps_s.size)
        shocks = self.noise_std_m_s * np.sqrt(1.0 - decay**2) * normal
        errors = list(
            accumulate(
                zip(decay.tolist(), shocks.tolist(), strict=True),
                lambda error, node: node[0] * error + node[1],
                initial=0.0,
            )
        )
        speeds = np.maximum(preview.speeds_m_s + np.array(errors), 0.0)
        # The error is linear between the nodes, so its integral is a sum of trapezoids.
        speed_errors = speeds - preview.speeds_m_s
        moved = np.cumsum(0.5 * steps_s * (speed_errors[1:] + speed_errors[:-1]))
        positions = preview.positions_m.copy()
        positions[1:] += moved
        # Between coarse nodes the true speed may dip below the line; no car drives backwards.
        np.maximum.accumulate(positions, out=positions)
        return LeaderPreview(preview.generated_at_s, preview.times_s, positions, speeds)

    def _random(self, purpose: _Purpose, number: int) -> np.random.Generator:
        """Return a generator that depends only on the seed, the purpose and the number."""
        # Philox is a function of key and counter: no state to carry from tick to tick. The lowest
        # 64 bits of the counter are left to the draws themselves.
        key = self.seed + (int(purpose) << 64)
        return np.random.Generator(np.random.Philox(key=key, counter=number << 64))


def age_s(preview: LeaderPreview, now_s: float) -> float:
    """Return the time since the generation of a prediction, infinite if there is none."""
    return now_s - preview.generated_at_s if preview.times_s.size else math.inf

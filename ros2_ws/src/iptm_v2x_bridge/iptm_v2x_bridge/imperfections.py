"""What goes wrong between the leader's prediction and the host: delay, loss and error.

Every random number depends only on the seed, the purpose and the stamp, never on what was drawn
before: a run can be repeated, joined late or replayed from the middle with the same numbers.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum
from itertools import accumulate

import numpy as np

from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S, LeaderPreview

TRANSMISSION_PERIOD_NS = NS_PER_S
"""One prediction is sent per sampling time; a slot of this length is lost or not as a whole."""

_FIRST_SLOT = 2**32  # keeps the number of a slot positive for bursts that began before the trip


class _Purpose(IntEnum):
    """Keeps the random numbers of different purposes apart."""

    LOSS = 1
    NOISE = 2


def latency_ns(settings: PreviewSettings) -> int:
    """Return the delay from generation to reception in integer nanoseconds."""
    return round(settings.latency_s * NS_PER_S)


def is_lost(settings: PreviewSettings, generated_ns: int) -> bool:
    """Return whether the prediction generated at an instant never arrives.

    Disturbances start independently in every slot and last `dropout_burst` slots; their rate is such
    that the share of lost predictions is `dropout_probability`, bursts or not.
    """
    probability, burst = settings.dropout_probability, settings.dropout_burst
    if probability <= 0.0:
        return False
    if probability >= 1.0:
        return True
    start_probability = 1.0 - (1.0 - probability) ** (1.0 / burst)
    slot = generated_ns // TRANSMISSION_PERIOD_NS + _FIRST_SLOT
    return any(
        _random(settings.seed, _Purpose.LOSS, slot - age).random() < start_probability
        for age in range(burst)
    )


def distort(settings: PreviewSettings, preview: LeaderPreview) -> LeaderPreview:
    """Return a prediction with a speed error, and with the positions that belong to it.

    The error starts at zero at the generation, as the leader measures its own speed, and grows to
    `noise_std_m_s` as a first-order process in time. Speeds stay at least zero, positions never
    decrease; without noise the prediction comes back untouched.
    """
    if settings.noise_std_m_s <= 0.0 or preview.times_s.size < 2:
        return preview
    steps_s = np.diff(preview.times_s)
    decay = np.exp(-steps_s / settings.noise_correlation_s)
    generated_ns = round(preview.generated_at_s * NS_PER_S)
    normal = _random(settings.seed, _Purpose.NOISE, generated_ns).standard_normal(steps_s.size)
    shocks = settings.noise_std_m_s * np.sqrt(1.0 - decay**2) * normal
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
    return replace(preview, positions_m=positions, speeds_m_s=speeds)


def _random(seed: int, purpose: _Purpose, number: int) -> np.random.Generator:
    """Return a generator that depends only on the seed, the purpose and the number."""
    # Philox is a function of key and counter: no state to carry from tick to tick. The lowest
    # 64 bits of the counter are left to the draws themselves.
    key = seed + (int(purpose) << 64)
    return np.random.Generator(np.random.Philox(key=key, counter=number << 64))

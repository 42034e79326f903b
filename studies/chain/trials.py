"""Trials with a chain ahead that lies or fails while the leader brakes, by the machinery of `collisions`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from numpy.random import Generator
from studies.collisions.families import BRAKES, FAMILIES, Draw, Family, Motion
from studies.collisions.family_trials import (
    AUTHENTICATED,
    ONE_AND_A_HALF_S,
    OPEN,
    TWO_S,
    Setting,
    trial,
)

from iptm_core.lead_track import RangeTrack
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S, LeaderPreview
from iptm_its.chain import ChainBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.range_sensor import RangeSensorBridge
from iptm_v2x_bridge.sender import car_on_road, packet_of

TIME_GAP_S, STANDSTILL_M, LENGTH_M = 1.5, 2.0, 4.5
RATE_HZ = 4
STATION = 7
SENSOR_BEHIND_M = 20.0
"""Where the sensor is, as seen from the leader: only differences count."""
LIES_BEFORE_S = 3.0
LARGEST_LIE_M_S2 = 4.0

Claim = Callable[[float, float, float], "tuple[float, float] | None"]
"""From time, and true position and speed of the vehicle ahead of the leader, to the claimed ones."""


class _ClaimedChain:
    """The preview that a bridge makes of the true leader and of the vehicle claimed to be ahead of it."""

    def __init__(self, true: Motion, claim: Claim, *, by_message: bool) -> None:
        self._true, self._claim = true, claim
        self._road = RoadLine.test_road()
        settings = PreviewSettings()
        self._messages = CamBridge(self._road, settings) if by_message else None
        self._sensor = RangeSensorBridge(self._messages)
        self._bridge = ChainBridge(
            self._sensor, settings, sensor=self._sensor, messages=self._messages
        )

    def __call__(self, time_s: float, _: LeaderPreview) -> LeaderPreview:
        time_ns = round(time_s * NS_PER_S)
        leader_m, leader_m_s = map(float, self._true.at(time_s))
        own_m = leader_m - SENSOR_BEHIND_M
        tracks = [RangeTrack(SENSOR_BEHIND_M, 0.0, 0.0)]
        if self._messages is None:
            seen = self._claimed(time_s)
            if seen is not None:
                tracks.append(RangeTrack(seen[0] - own_m, 0.0, seen[1] - leader_m_s))
        else:
            self._hear(self._messages, time_s)
        self._sensor.take(time_ns, tuple(tracks))
        return self._bridge.answer(time_ns, own_m, leader_m_s).preview

    def _claimed(self, time_s: float) -> tuple[float, float] | None:
        position_m, speed_m_s = map(float, self._true.at(time_s + TIME_GAP_S))
        return self._claim(time_s, position_m + STANDSTILL_M + LENGTH_M, speed_m_s)

    def _hear(self, messages: CamBridge, time_s: float) -> None:
        for number in range(RATE_HZ):
            sent_s = time_s - (RATE_HZ - 1 - number) / RATE_HZ
            claimed = self._claimed(sent_s) if sent_s >= 0.0 else None
            if claimed is not None:
                sent_ms = round(1000.0 * sent_s)
                place_m, speed_m_s = claimed[0], max(claimed[1], 0.0)
                message = car_on_road(self._road, STATION, sent_ms, place_m, speed_m_s)
                messages.receive(packet_of(message, sent_ms), sent_ms * 1_000_000)


def _honest(_: Generator, __: float) -> Claim:
    return lambda _, position_m, speed_m_s: (position_m, speed_m_s)


def _speeding(random: Generator, at_s: float) -> Claim:
    lie_m_s2 = float(random.uniform(0.5, LARGEST_LIE_M_S2))

    def claim(time_s: float, position_m: float, speed_m_s: float) -> tuple[float, float]:
        passed_s = max(time_s - at_s + LIES_BEFORE_S, 0.0)
        return position_m + 0.5 * lie_m_s2 * passed_s**2, speed_m_s + lie_m_s2 * passed_s

    return claim


def _slowing(random: Generator, at_s: float) -> Claim:
    lie_m_s2 = float(random.uniform(0.5, LARGEST_LIE_M_S2))

    def claim(time_s: float, position_m: float, speed_m_s: float) -> tuple[float, float]:
        passed_s = min(max(time_s - at_s + LIES_BEFORE_S, 0.0), speed_m_s / lie_m_s2)
        return position_m - 0.5 * lie_m_s2 * passed_s**2, speed_m_s - lie_m_s2 * passed_s

    return claim


def _jumping(random: Generator, at_s: float) -> Claim:
    jumps_m = random.uniform(-3.0, 40.0, 200)

    def claim(time_s: float, position_m: float, speed_m_s: float) -> tuple[float, float]:
        jumps = jumps_m[int(time_s) % jumps_m.size] if time_s > at_s - LIES_BEFORE_S else 0.0
        return position_m + float(jumps), speed_m_s

    return claim


def _repeating(random: Generator, at_s: float) -> Claim:
    since_s = at_s - float(random.uniform(0.0, LIES_BEFORE_S))
    kept: list[tuple[float, float]] = []

    def claim(time_s: float, position_m: float, speed_m_s: float) -> tuple[float, float]:
        if time_s < since_s or not kept:
            kept[:] = [(position_m, speed_m_s)]
        return kept[0]

    return claim


def _constant(_: Generator, at_s: float) -> Claim:
    """Return a vehicle that keeps its speed: the leader brakes for another reason."""
    kept: list[tuple[float, float, float]] = []

    def claim(time_s: float, position_m: float, speed_m_s: float) -> tuple[float, float]:
        if time_s < at_s - LIES_BEFORE_S or not kept:
            kept[:] = [(time_s, position_m, speed_m_s)]
        then_s, then_m, then_m_s = kept[0]
        return then_m + then_m_s * (time_s - then_s), then_m_s

    return claim


def _lost(random: Generator, at_s: float) -> Claim:
    since_s = at_s - float(random.uniform(0.0, LIES_BEFORE_S))
    return lambda time_s, position_m, speed_m_s: (
        (position_m, speed_m_s) if time_s < since_s else None
    )


CLAIMS: Mapping[str, Callable[[Generator, float], Claim]] = {
    "honest": _honest,
    "speeds up": _speeding,
    "slows down": _slowing,
    "jumps": _jumping,
    "repeats itself": _repeating,
    "keeps its speed": _constant,
    "is lost": _lost,
}
BY_SENSOR, BY_MESSAGE = "second track", "message"


def _family(claims: Callable[[Generator, float], Claim], *, by_message: bool) -> Family:
    def draw(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
        drawn = FAMILIES[BRAKES](random, drive, at_s, most_m_s2)
        claim = claims(random, at_s)
        radio = _ClaimedChain(drawn.true, claim, by_message=by_message)
        return replace(drawn, radio=radio)

    return draw


CHAIN_FAMILIES: Mapping[str, Family] = {
    f"{source} {name}": _family(claims, by_message=source == BY_MESSAGE)
    for source in (BY_SENSOR, BY_MESSAGE)
    for name, claims in CLAIMS.items()
}

SETTINGS = tuple(
    Setting(family, headway, radio)
    for family, headway, radio in product(
        CHAIN_FAMILIES, (TWO_S, ONE_AND_A_HALF_S), (OPEN, AUTHENTICATED)
    )
)


def chain_trials(setting: Setting, count: int, seed: int) -> pd.DataFrame:
    """Return a row per trial of a family; the published cycles take turns by chance."""
    rows = []
    for number in range(count):
        drive = str(np.random.default_rng([seed, number]).choice(list(CYCLE_NAMES)))
        rows.append(trial(setting, drive, (seed, number), CHAIN_FAMILIES))
    return pd.DataFrame(rows)

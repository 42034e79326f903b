"""Trips behind leaders of measured platoons, with what sources show of the vehicle ahead of the leader."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from studies.chain.platoons import CAR_LENGTH_M, HELD_OUT, PER_S
from studies.glosa import drive_advised
from studies.measured_cycles import longest_known, write_drive
from studies.validation import excerpts

import iptm
from iptm.closed_loop import TickController, decided
from iptm.driving import controller_for, trip_in_ticks
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_core.lead_track import RangeTrack
from iptm_core.state import NS_PER_S, FloatArray
from iptm_its.chain import ChainBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.range_sensor import RangeSensorBridge
from iptm_v2x_bridge.sender import car_on_road, packet_of

RUN_IN_S, RUN_IN_M_S2 = 40, 1.0
LONGEST_S = 300
RATE_HZ = 4
STATION = 42
SECOND_TRACK, MESSAGES = "second track", "messages"
FARTHER = "messages of the one ahead of that"


@dataclass(frozen=True, eq=False)
class ChainScene:
    """A leader and the vehicle ahead of it at steps of a second, after a run-in from standstill.

    Attributes:
        name: unique name.
        speed_m_s: of the leader, shape (n,).
        ahead_m_s: speed of the vehicle ahead of it, shape (n,).
        gap_m: between both, shape (n,).
        farther_m_s: speed of the vehicle ahead of that, NaN where it is not measured, shape (n,).
        farther_gap_m: between the leader and that one, shape (n,).
        stations: numbers of both vehicles ahead, shape (2, n).
    """

    name: str
    speed_m_s: FloatArray
    ahead_m_s: FloatArray
    gap_m: FloatArray
    farther_m_s: FloatArray
    farther_gap_m: FloatArray
    stations: NDArray[np.intp]

    @property
    def duration_s(self) -> float:
        """Length of the scene."""
        return float(self.speed_m_s.size - 1)

    def write(self, folder: Path) -> str:
        """Write the drive of the leader; returns the path as a cycle of a run."""
        return str(write_drive(folder / f"{self.name}.csv", 1.0, self.speed_m_s))


def scenes(place: int) -> list[ChainScene]:
    """Return one scene of every held-out run: the leader that drove at a place, or the next one behind it."""
    found: dict[str, ChainScene] = {}
    by_name = {drive.name: drive for drive in excerpts.drives() if drive.gap_m is not None}
    for drive in by_name.values():
        at = int(drive.name.rsplit("/", 1)[1])
        if drive.run not in HELD_OUT or drive.run in found or at < place:
            continue
        samples = np.arange(drive.speed_m_s.size)
        columns = [drive.speed_m_s, drive.leader_speed_m_s, drive.gap_m, samples]
        known = longest_known(np.array(columns))
        count = min(known.shape[1] // PER_S, LONGEST_S)
        speed, ahead, gap = known[:3, : count * PER_S].reshape(3, count, PER_S).mean(axis=2)
        speed, ahead = np.maximum(speed, 0.0), np.maximum(ahead, 0.0)
        farther, farther_gap = np.full((2, count), np.nan)
        between = by_name.get(f"{drive.run}/{at - 1}")
        if between is not None:
            first = int(known[3, 0])
            both = np.array([between.leader_speed_m_s, between.gap_m])[:, first:][
                :, : count * PER_S
            ]
            whole = both.shape[1] // PER_S
            both = both[:, : whole * PER_S].reshape(2, whole, PER_S).mean(axis=2)
            farther[:whole] = np.maximum(both[0], 0.0)
            farther_gap[:whole] = gap[:whole] + CAR_LENGTH_M + both[1]
        ramp = RUN_IN_M_S2 * np.arange(RUN_IN_S, dtype=np.float64)
        found[drive.run] = ChainScene(
            drive.name.replace("/", "_"),
            np.append(np.minimum(ramp, speed[0]), speed),
            np.append(np.minimum(ramp, ahead[0]), ahead),
            np.append(np.full(RUN_IN_S, gap[0]), gap),
            np.append(np.minimum(ramp, farther[0]), farther),
            np.append(np.full(RUN_IN_S, farther_gap[0]), farther_gap),
            np.repeat([[0], [1]], RUN_IN_S + count, axis=1),
        )
    return list(found.values())


class ChainAhead:
    """What the bridge would answer: the leader by the sensor, and the vehicle ahead of it by some sources.

    Args:
        scene: leader and vehicle ahead; None where none is measured.
        trip: gives road and previews.
        source: what shows the vehicle ahead.
        delay_s: of messages.
        loss: share of the messages that are lost.
        seed: of the losses.
        rules: signals that are announced, for sure; None for none.
    """

    def __init__(
        self,
        scene: ChainScene | None,
        trip: iptm.Trip,
        source: str = SECOND_TRACK,
        delay_s: float = 0.0,
        loss: float = 0.0,
        seed: int = 0,
        rules: RoadRules | None = None,
    ) -> None:
        self._scene, self._road = scene, trip.route.road_line
        self._delay_ns, self._loss = round(delay_s * NS_PER_S), loss
        self._random = np.random.default_rng(seed)
        self._farther = source == FARTHER
        hears = source in {MESSAGES, FARTHER}
        self._messages = CamBridge(self._road, trip.preview) if hears else None
        self._sensor = RangeSensorBridge(self._messages)
        self.bridge = ChainBridge(
            self._sensor,
            trip.preview,
            sensor=self._sensor,
            messages=self._messages,
            rules=None if rules is None else (rules, rules),
        )

    def seen(self, measured: Measurements) -> Measurements:
        """Return the measurements of a tick with the preview that the chain gives."""
        state, leader = measured.state, measured.leader
        if state is None or leader is None:
            return measured
        time_ns = round(state.time_s * NS_PER_S)
        places, scene = [(leader.position_m, leader.speed_m_s)], self._scene
        if scene is not None:
            second = min(round(state.time_s), scene.gap_m.size - 1)
            gap_m, ahead_m_s = scene.gap_m[second], scene.ahead_m_s[second]
            if self._farther:
                gap_m, ahead_m_s = scene.farther_gap_m[second], scene.farther_m_s[second]
            ahead = leader.position_m + CAR_LENGTH_M + float(gap_m), float(ahead_m_s)
            if not np.isfinite(ahead).all():
                pass
            elif self._messages is None:
                places.append(ahead)
            else:
                station = STATION + int(scene.stations[int(self._farther), second])
                self._hear(self._messages, time_ns, station, *ahead)
        own_m, own_m_s = state.position_m, state.speed_m_s
        tracks = (RangeTrack(place - own_m, 0.0, speed - own_m_s) for place, speed in places)
        self._sensor.take(time_ns, tuple(tracks))
        answer = self.bridge.answer(time_ns, own_m, own_m_s)
        return replace(measured, preview=answer.preview)

    def _hear(
        self, messages: CamBridge, time_ns: int, station: int, ahead_m: float, ahead_m_s: float
    ) -> None:
        """Let the vehicle ahead send in the last second before a tick, as it drives at the tick."""
        for number in range(RATE_HZ):
            sent_ns = time_ns - self._delay_ns - (RATE_HZ - 1 - number) * NS_PER_S // RATE_HZ
            if sent_ns < 0 or self._random.random() < self._loss:
                continue
            before_s = (time_ns - sent_ns) / NS_PER_S
            message = car_on_road(
                self._road,
                station,
                sent_ns // 1_000_000,
                ahead_m - ahead_m_s * before_s,
                ahead_m_s,
            )
            arrived_ns = min(sent_ns + self._delay_ns, time_ns)
            messages.receive(packet_of(message, sent_ns // 1_000_000), arrived_ns)


def drive(
    call: Mapping[str, Any],
    scene: ChainScene | None = None,
    *,
    advised: bool = False,
    **sources: Any,
) -> tuple[iptm.Run, dict[str, int]]:
    """Drive a trip, with a chain ahead if a scene is given; see `ChainAhead` for its sources.

    Args:
        call: arguments of `iptm.simulate`.
        scene: leader and vehicles ahead of it.
        advised: with the speed advice of `studies.glosa`.

    Returns:
        The run, and the ticks by what the preview was made of.
    """
    if advised:
        return drive_advised(call, keeps_lines=False), {}
    trip = iptm.Trip.of(**call)
    if scene is None and not sources:
        return iptm.drive(trip), {}
    chain = ChainAhead(scene, trip, **sources)
    run = decided(trip_in_ticks(trip), _Shown(controller_for(trip), chain))
    return run, dict(chain.bridge.counts)


class _Shown:
    """A controller that is shown the preview of a chain."""

    def __init__(self, inner: TickController, chain: ChainAhead) -> None:
        self._inner, self._chain, self.options = inner, chain, inner.options

    def decide(self, measured: Measurements) -> Decision:
        """Return the decision with the preview of the chain."""
        return self._inner.decide(self._chain.seen(measured))

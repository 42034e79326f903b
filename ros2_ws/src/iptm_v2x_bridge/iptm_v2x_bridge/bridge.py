"""The bridge without ROS: for every tick, the leader now and the prediction held on board.

Between a prediction and the ego vehicle there are delay, loss and error. Every random number depends only on
the seed, the purpose and the stamp, never on what was drawn before: a run can be repeated, joined late or
replayed from the middle with the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import accumulate
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iptm_core.frozen import replace
from iptm_core.lead_track import clear_lane
from iptm_core.road_ahead import RoadAhead
from iptm_core.routes import Route
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState, SlopePreview


@dataclass(frozen=True)
class BridgeAnswer:
    """Answer of the bridge at one tick.

    Attributes:
        time_ns: the tick, integer nanoseconds of trip time.
        leader: state of the leader at the tick; None without a leader.
        preview: latest prediction received, with its own time of generation.
        lost: whether the prediction generated at this tick is lost on the way.
        predictor: predictor in use on the leader's messages; empty without one.
        leader_bound_m: conservative reduction of the leader's distance.
        contested: whether messages with the identity of the leader contradict each other.
        road: rules of the road, None where none are known.
    """

    time_ns: int
    leader: LeaderState | None
    preview: LeaderPreview
    lost: bool
    predictor: str = ""
    leader_bound_m: float = 0.0
    contested: bool = False
    road: RoadAhead | None = None

    @property
    def preview_age_s(self) -> float:
        """Time since the generation of the preview, infinite if there is none."""
        return self.preview.age_s(self.time_ns / NS_PER_S)


class TickBridge(Protocol):
    """What answers ticks, whatever the source of the leader's motion."""

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick.

        Args:
            time_ns: the tick, integer nanoseconds of trip time.
            ego_position_m: front of the ego vehicle along the road at the tick.
            ego_speed_m_s: its speed; plays no part without rules of the road.
        """
        ...


class V2xBridge:
    """Answers ticks in increasing order of time.

    The same tick asked again gets the same answer; an earlier one means that a new trip has begun.

    Attributes:
        sent: predictions generated in this trip, lost ones included.
        lost: predictions lost in this trip.
    """

    def __init__(
        self,
        source: PreviewSource,
        settings: PreviewSettings | None = None,
        earlier_ticks_ns: range = range(0),
    ) -> None:
        """Set up a bridge at the beginning of a trip."""
        self._source = source
        self._settings = settings or PreviewSettings()
        self._earlier_ticks_ns = earlier_ticks_ns
        self._restart()

    def _restart(self) -> None:
        self._in_flight: list[tuple[int, LeaderPreview]] = []
        self._latest = LeaderPreview.empty()
        self._last: BridgeAnswer | None = None
        self.sent = 0
        self.lost = 0

    def answer(
        self,
        time_ns: int,
        ego_position_m: float = 0.0,  # noqa: ARG002
        ego_speed_m_s: float = 0.0,  # noqa: ARG002
    ) -> BridgeAnswer:
        """Return the answer to one tick; the place of the ego plays no part. See `TickBridge.answer`."""
        if self._last is not None and time_ns == self._last.time_ns:
            return self._last
        if self._last is not None and time_ns < self._last.time_ns:
            self._restart()
        leader, lost = self._source.leader_at(time_ns), False
        if self._settings.preview_mode is not PreviewMode.NONE:
            if self._last is None and time_ns == self._earlier_ticks_ns.stop:
                for earlier_ns in self._earlier_ticks_ns:
                    self._transmit(earlier_ns)
            lost = self._transmit(time_ns)
        self._last = BridgeAnswer(time_ns, leader, self._latest, lost)
        return self._last

    def _transmit(self, time_ns: int) -> bool:
        """Send the prediction of this tick and receive what has arrived; return whether it is lost.

        The newest prediction by its time of generation is held exactly as it was generated: its age must stay
        visible to its user.
        """
        self.sent += 1
        lost = is_lost(self._settings, time_ns)
        if lost:
            self.lost += 1
        else:
            preview = self._source.predict(preview_times_s(self._settings, time_ns))
            due_ns = time_ns + latency_ns(self._settings)
            self._in_flight.append((due_ns, distort(self._settings, preview)))
        while self._in_flight and self._in_flight[0][0] <= time_ns:
            _, preview = self._in_flight.pop(0)
            if preview.times_s.size and preview.generated_at_s >= self._latest.generated_at_s:
                self._latest = preview
        return lost


class PreviewSource(Protocol):
    """Source of the leader: its state, and a prediction of its motion."""

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the leader's state at an instant (integer nanoseconds of trip time), None without one."""
        ...

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the prediction made at the first of its node times, where it is `leader_at`."""
        ...

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return what a range sensor measures of the leader at the given instants of an interval.

        The first instant must be available; later ones may be missing and are left out.
        """
        ...


def preview_times_s(settings: PreviewSettings, generated_ns: int) -> FloatArray:
    """Return the node times of a prediction: its generation, then whole multiples of the step.

    All predictions share these multiples, so a trace with samples there loses none of its corners, whenever
    the prediction is generated.

    Returns:
        Trip times in s, shape (n,), exact to the nanosecond.
    """
    step_ns = round(settings.preview_step_s * NS_PER_S)
    last_ns = generated_ns + round(settings.preview_length_s * NS_PER_S)
    first = generated_ns // step_ns
    nodes_ns = _multiples(step_ns, last_ns // step_ns + 1 - first) + first * step_ns
    nodes_ns[0] = generated_ns
    times: FloatArray = nodes_ns / 1e9
    return times


@lru_cache(maxsize=64)
def _multiples(step: int, count: int) -> NDArray[np.int64]:
    return step * np.arange(max(count, 1), dtype=np.int64)


def sampling_times_s(time_ns: int, interval_s: float, period_s: float) -> FloatArray:
    """Return the instants at which a range sensor measures in an interval, its start included."""
    period_ns = round(period_s * NS_PER_S)
    count = -(-round(interval_s * NS_PER_S) // period_ns)
    times: FloatArray = (time_ns + _multiples(period_ns, count)) / NS_PER_S
    return times


def single_sample(leader: LeaderState | None, time_s: float) -> LeaderPreview:
    """Return one measurement of the leader as what a range sensor measures; a clear lane for no leader."""
    if leader is None:
        return clear_lane(time_s)
    return LeaderPreview(
        np.array([leader.time_s]),
        np.array([leader.position_m]),
        np.array([leader.speed_m_s]),
    )


class CycleSource:
    """Perfect predictions: a leader that drives a route and stands still past the end of the trip."""

    def __init__(self, route: Route) -> None:
        self.route = route

    def leader_at(self, time_ns: int) -> LeaderState:
        """Return the leader's state at an instant (integer nanoseconds of trip time)."""
        return self.route.leader.state_at(time_ns / NS_PER_S)

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return what the leader is going to do, without any error; see `PreviewSource`."""
        return LeaderPreview(times_s, *self.route.leader.motion_at(times_s))

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the leader at all of the instants; see `PreviewSource`."""
        return self.predict(times_s)

    def slope_ahead(self) -> SlopePreview:
        """Return the slope of the whole road, as a map holds it."""
        return SlopePreview(self.route.slope.positions_m, self.route.slope.slopes_rad)


class EmptyRoad:
    """No vehicle ahead: a `PreviewSource` without states and predictions."""

    def leader_at(self, time_ns: int) -> None:
        """Return None; see `PreviewSource`."""

    def predict(self, times_s: FloatArray) -> LeaderPreview:  # noqa: ARG002
        """Return the empty prediction."""
        return LeaderPreview.empty()

    def sampled(self, times_s: FloatArray) -> LeaderPreview:  # noqa: ARG002
        """Return no measurement: the road is free."""
        return LeaderPreview.empty()


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

"""Families of trials: what a vehicle ahead does, and what sensor, radio, car, road and processes make of it.

Times are seconds of the trip, motions are sampled at `STEP_S`. A family draws its numbers from a generator,
and `family_trials` drives what it returns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import Generator
from studies.collisions.recorded import STEP_S

from iptm_core.state import FloatArray, LeaderPreview

Seen = tuple[float, float]
"""Position and speed of the vehicle ahead as a range sensor has them."""
Sensor = Callable[[float, float, float, float], "Seen | None"]
"""From time, position and speed of the vehicle ahead, and own position, to what is measured."""
Radio = Callable[[float, LeaderPreview], LeaderPreview]
LEAD_BRAKES_M_S2 = (2.0, 9.0)
BLIND_S = (1.0, 2.0, 4.0, 8.0)
"""Times for which a range sensor repeats itself or coasts."""


@dataclass(frozen=True)
class Motion:
    """Positions and speeds of a vehicle at `STEP_S` from 0 s on, shapes (n,); its last ones are held."""

    positions_m: FloatArray
    speeds_m_s: FloatArray

    @classmethod
    def of(cls, start_m: float, speeds_m_s: FloatArray) -> Motion:
        """Return the motion with given speeds."""
        steps_m = 0.5 * (speeds_m_s[1:] + speeds_m_s[:-1]) * STEP_S
        return cls(start_m + np.concatenate(([0.0], np.cumsum(steps_m))), speeds_m_s)

    def at(self, times_s: Any) -> tuple[Any, Any]:
        """Return positions and speeds at times."""
        places = np.asarray(times_s) / STEP_S
        steps = np.arange(self.speeds_m_s.size)
        return (
            np.interp(places, steps, self.positions_m),
            np.interp(places, steps, self.speeds_m_s),
        )

    def braking(self, at_s: float, deceleration_m_s2: float) -> Motion:
        """Return the same motion until an instant, and braking to a halt from there."""
        first = round(at_s / STEP_S)
        speeds = self.speeds_m_s.copy()
        lost = deceleration_m_s2 * STEP_S * np.arange(speeds.size - first)
        speeds[first:] = np.maximum(speeds[first] - lost, 0.0)
        return Motion.of(self.positions_m[0], speeds)

    def replaced(self, at_s: float, position_m: float, speeds_m_s: FloatArray) -> Motion:
        """Return the same motion until an instant, and the one of another vehicle from there on."""
        first = round(at_s / STEP_S)
        rest = Motion.of(position_m, speeds_m_s[: self.speeds_m_s.size - first])
        return Motion(
            np.concatenate((self.positions_m[:first], rest.positions_m)),
            np.concatenate((self.speeds_m_s[:first], rest.speeds_m_s)),
        )


Event = Callable[[Motion, float, float], Motion]
"""From the motion so far, and own position and speed at an instant, to the motion from then on."""


@dataclass(frozen=True)
class Draw:
    """One trial.

    Attributes:
        drawn: numbers that were drawn, by name.
        true: motion of the vehicle ahead but for events.
        onset_s: from when on a bound may react.
        events: what happens at instants, in order.
        sensor: what the range sensor makes of it; None for a sound one.
        is_empty: a missing measurement is reported as an empty lane.
        returns_s: when the sensor is sound again; None where it always is.
        radio: what the messages make of it; None for sound ones.
        is_announced: messages predict what is to come; else an honest sender goes on at its speed.
        car: ``strength`` of the brakes and how fast it ``fades``, ``friction`` and ``slope`` of the road,
            factor of the ``mass``; what is missing is as usual.
        process: ``controller_s`` and ``monitor_s``, when one of them restarts; ``late_ticks`` of commands.
        published: instant and friction of a message.
    """

    drawn: Mapping[str, float | str]
    true: Motion
    onset_s: float
    events: tuple[tuple[float, Event], ...] = ()
    sensor: Sensor | None = None
    is_empty: bool = False
    returns_s: float | None = None
    radio: Radio | None = None
    is_announced: bool = False
    car: Mapping[str, float] = field(default_factory=dict)
    process: Mapping[str, float] = field(default_factory=dict)
    published: tuple[float, float] | None = None


Family = Callable[[Generator, Motion, float, float], Draw]
"""From generator, undisturbed motion, instant of the event and hardest deceleration of the vehicle ahead."""


def _braking(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    low, high = LEAD_BRAKES_M_S2
    high = min(high, most_m_s2)
    braked = round(float(random.uniform(min(low, 0.4 * high), high)), 2)
    return Draw({"brakes_m_s2": braked}, drive.braking(at_s, braked), at_s)


def _on_road(**car: tuple[float, float]) -> Family:
    def draw(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
        values = {name: float(random.uniform(*bounds)) for name, bounds in car.items()}
        return replace(_braking(random, drive, at_s, most_m_s2), car=values)

    return draw


def _cut_in(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    slower, gap_m = float(random.uniform(0.0, 15.0)), float(random.uniform(6.0, 60.0))
    braked = min(float(random.choice([0.0, 0.0, 2.0, 5.0])), most_m_s2)

    def event(before: Motion, own_m: float, own_m_s: float) -> Motion:
        lost = braked * STEP_S * np.arange(before.speeds_m_s.size)
        speeds = np.maximum(max(own_m_s - slower, 0.0) - lost, 0.0)
        return before.replaced(at_s, own_m + gap_m, speeds)

    drawn = {"slower_m_s": slower, "gap_m": gap_m, "brakes_m_s2": braked}
    return Draw(drawn, drive, at_s, ((at_s, event),))


def _standing(at_s: float, gap_m: float) -> Event:
    def event(before: Motion, own_m: float, _: float) -> Motion:
        ahead_m = float(before.at(at_s)[0])
        return before.replaced(at_s, max(own_m + gap_m, ahead_m), np.zeros(before.speeds_m_s.size))

    return event


def _cut_in_and_out(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """A vehicle cuts in, leaves the lane again, and a standing one is where it was hiding it."""
    draw = _cut_in(random, drive, at_s, most_m_s2)
    leaves_s = round(at_s + float(random.uniform(1.0, 5.0)), 2)
    gap_m = float(random.uniform(20.0, 110.0))
    events = (*draw.events, (leaves_s, _standing(leaves_s, gap_m)))
    drawn = {**draw.drawn, "leaves_s": leaves_s - at_s, "standing_m": gap_m}
    return replace(draw, drawn=drawn, events=events, onset_s=leaves_s)


def _motorcycle(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """A short vehicle joins near by and is seen late; the one ahead of it is reported until then."""
    draw = _cut_in(random, drive, at_s, most_m_s2)
    seen_s = round(at_s + float(random.uniform(0.3, 1.5)), 2)

    def sensor(time_s: float, position_m: float, speed_m_s: float, _: float) -> Seen:
        if at_s <= time_s < seen_s:
            position_m, speed_m_s = drive.at(time_s)
            return float(position_m), float(speed_m_s)
        return position_m, speed_m_s

    return replace(
        draw, drawn={**draw.drawn, "seen_after_s": seen_s - at_s}, sensor=sensor, onset_s=seen_s
    )


def _blind(noise_m: float = 0.0, noise_m_s: float = 0.0, *, coasts: bool = False) -> Family:
    """The range sensor repeats the last gap and speed within noise, or goes on at constant speed."""

    def draw(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
        braking = _braking(random, drive, at_s, most_m_s2)
        lasts_s, begins_s = float(random.choice(BLIND_S)), at_s - float(random.uniform(0.0, 2.0))
        noise = np.random.default_rng(int(random.integers(1 << 30)))
        kept: list[tuple[float, float, float, float]] = []

        def sensor(time_s: float, position_m: float, speed_m_s: float, own_m: float) -> Seen:
            if not begins_s <= time_s < begins_s + lasts_s:
                return position_m, speed_m_s
            if not kept:
                kept.append((time_s, position_m, speed_m_s, position_m - own_m))
            since_s, was_m, speed_m_s, gap_m = kept[0]
            at_m = was_m + speed_m_s * (time_s - since_s) if coasts else own_m + gap_m
            return (
                at_m + noise_m * float(noise.standard_normal()),
                speed_m_s + noise_m_s * float(noise.standard_normal()),
            )

        drawn = {**braking.drawn, "blind_s": lasts_s, "before_s": at_s - begins_s}
        return replace(braking, drawn=drawn, sensor=sensor, returns_s=begins_s + lasts_s)

    return draw


def _missing(*, is_empty: bool) -> Family:
    """The range sensor is silent, or reports an empty lane."""

    def draw(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
        braking = _braking(random, drive, at_s, most_m_s2)
        lasts_s = float(random.choice([0.5, 1.0, 2.0, 3.0, 5.0, 8.0]))
        begins_s = at_s + float(random.uniform(-0.3, 0.3))

        def sensor(time_s: float, position_m: float, speed_m_s: float, _: float) -> Seen | None:
            is_missing = begins_s <= time_s < begins_s + lasts_s
            return None if is_missing else (position_m, speed_m_s)

        drawn = {**braking.drawn, "missing_s": lasts_s}
        return replace(braking, drawn=drawn, sensor=sensor, is_empty=is_empty)

    return draw


def _scaled(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """Gap or relative speed come with a wrong factor or offset, for the rest of the trip."""
    braking = _braking(random, drive, at_s, most_m_s2)
    begins_s = at_s - float(random.uniform(1.0, 15.0))
    what = str(random.choice(["gap", "speed"]))
    factor = float(random.choice([1.1, 1.5] if what == "gap" else [0.0, 0.5, -1.0]))
    offset_m = float(random.choice([0.0, 10.0])) if what == "gap" else 0.0
    last: list[tuple[float, float]] = []

    def sensor(time_s: float, position_m: float, speed_m_s: float, own_m: float) -> Seen:
        last.append((time_s, own_m))
        if time_s < begins_s:
            return position_m, speed_m_s
        if what == "gap":
            return own_m + factor * (position_m - own_m) + offset_m, speed_m_s
        then_s, then_m = next((row for row in reversed(last) if row[0] < time_s), last[0])
        own_m_s = (own_m - then_m) / max(time_s - then_s, STEP_S)
        return position_m, max(own_m_s + factor * (speed_m_s - own_m_s), 0.0)

    drawn = {**braking.drawn, what: factor, "offset_m": offset_m}
    return replace(braking, drawn=drawn, sensor=sensor)


def _too_long(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """The gap is measured too long by some metres for a while."""
    braking = _braking(random, drive, at_s, most_m_s2)
    by_m, lasts_s = float(random.choice([3.0, 5.0, 8.0])), float(random.uniform(1.0, 15.0))
    begins_s = at_s - float(random.uniform(0.0, 3.0))

    def sensor(time_s: float, position_m: float, speed_m_s: float, _: float) -> Seen:
        is_off = begins_s <= time_s < begins_s + lasts_s
        return position_m + by_m * is_off, speed_m_s

    return replace(braking, drawn={**braking.drawn, "too_long_m": by_m}, sensor=sensor)


def _restarted(process: str) -> Family:
    def draw(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
        braking = _braking(random, drive, at_s, most_m_s2)
        return replace(braking, process={process: at_s + float(random.uniform(-1.0, 4.0))})

    return draw


def _late(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    braking = _braking(random, drive, at_s, most_m_s2)
    return replace(braking, process={"late_ticks": float(random.integers(1, 3))})


def _two(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """One fault of the range sensor, and one of car or processes."""
    first = str(random.choice(sorted(_OF_SENSOR)))
    second = str(random.choice(sorted(_OF_CAR)))
    draw, other = (
        family(random, drive, at_s, most_m_s2) for family in (_OF_SENSOR[first], _OF_CAR[second])
    )
    drawn = {**draw.drawn, "two": f"{first}, {second}"}
    return replace(draw, drawn=drawn, car=other.car, process=other.process)


def _published(random: Generator, drive: Motion, at_s: float, _: float) -> Draw:
    """On a dry road, behind a vehicle that drives on, a message states a slippery one."""
    friction = float(random.choice([0.001, 0.1, 0.2, 0.35]))
    return Draw({"friction": friction}, drive, at_s, published=(at_s, friction), is_announced=True)


def moved(preview: LeaderPreview, nearer_m: float, slower_m_s: float) -> LeaderPreview:
    """Return a preview of a vehicle that is nearer and slower, and consistent in itself."""
    if not preview.times_s.size:
        return preview
    speeds = np.maximum(preview.speeds_m_s - slower_m_s, 0.0)
    steps_m = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(preview.times_s)
    positions = preview.positions_m[0] - nearer_m + np.concatenate(([0.0], np.cumsum(steps_m)))
    return replace(preview, positions_m=positions, speeds_m_s=speeds)


def _lie_of_now(random: Generator, drive: Motion, at_s: float, _: float) -> Draw:
    """Messages place the vehicle ahead, which drives on, nearer and slower, and go on from there."""
    nearer_m, slower = float(random.uniform(5.0, 40.0)), float(random.uniform(3.0, 12.0))

    def radio(time_s: float, preview: LeaderPreview) -> LeaderPreview:
        if not at_s <= time_s < at_s + 15.0:
            return preview
        return moved(preview, nearer_m + slower * (time_s - at_s), slower)

    drawn = {"nearer_m": nearer_m, "slower_m_s": slower}
    return Draw(drawn, drive, at_s, radio=radio, is_announced=True)


def _lie_of_plan(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """The present is right, and the messages hide the braking: the vehicle goes on, or accelerates."""
    braking = _braking(random, drive, at_s, most_m_s2)
    gains = float(random.choice([0.0, 0.5, 1.5]))

    def radio(_: float, preview: LeaderPreview) -> LeaderPreview:
        if not preview.times_s.size:
            return preview
        position_m, speed_m_s = braking.true.at(preview.times_s[0])
        elapsed = preview.times_s - preview.times_s[0]
        speeds = np.minimum(speed_m_s + gains * elapsed, 35.0)
        steps_m = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(elapsed)
        positions = position_m + np.concatenate(([0.0], np.cumsum(steps_m)))
        return replace(preview, positions_m=positions, speeds_m_s=speeds)

    return replace(braking, drawn={**braking.drawn, "gains_m_s2": gains}, radio=radio)


def _replayed(random: Generator, drive: Motion, at_s: float, most_m_s2: float) -> Draw:
    """Messages of some time ago come again with new stamps."""
    braking = _braking(random, drive, at_s, most_m_s2)
    ago_s = float(random.uniform(10.0, 40.0))

    def radio(time_s: float, preview: LeaderPreview) -> LeaderPreview:
        if not preview.times_s.size or time_s < at_s - 2.0:
            return preview
        positions, speeds = drive.at(preview.times_s - ago_s)
        return replace(preview, positions_m=positions, speeds_m_s=speeds)

    return replace(braking, drawn={**braking.drawn, "ago_s": ago_s}, radio=radio)


_OF_SENSOR: Mapping[str, Family] = {
    "blind": _blind(0.05, 0.02),
    "empty": _missing(is_empty=True),
    "too long": _too_long,
}
_OF_CAR: Mapping[str, Family] = {
    "weak brakes": _on_road(strength=(0.7, 0.9)),
    "late commands": _late,
    "controller restarted": _restarted("controller_s"),
    "monitor restarted": _restarted("monitor_s"),
}
BRAKES, CUT_IN = "braking", "cut-in"
FROZEN_1, FROZEN_5, COASTING = "frozen within 1 mm", "frozen within 5 cm", "coasting"
SCALED = "wrong scale"
TWO, PUBLISHED, LIE_OF_NOW = "two faults at once", "published friction", "radio lies: present"
FAMILIES: Mapping[str, Family] = {
    BRAKES: _braking,
    CUT_IN: _cut_in,
    "cut-in, then out, a standing car": _cut_in_and_out,
    "motorcycle, seen late": _motorcycle,
    FROZEN_1: _blind(0.001, 0.001),
    FROZEN_5: _blind(0.05, 0.02),
    COASTING: _blind(coasts=True),
    "sensor silent": _missing(is_empty=False),
    "lane reported empty": _missing(is_empty=True),
    SCALED: _scaled,
    "gap too long": _too_long,
    TWO: _two,
    "descent of 10 to 20 %": _on_road(slope=(-0.2, -0.1)),
    "ice, not known": _on_road(friction=(0.1, 0.2)),
    "fading brakes": _on_road(fades=(0.3, 1.0)),
    "1.5 times the mass, 2/3 of the brakes": _on_road(mass=(1.5, 1.5), strength=(0.667, 0.667)),
    "controller restarted": _OF_CAR["controller restarted"],
    "monitor restarted": _OF_CAR["monitor restarted"],
    PUBLISHED: _published,
    LIE_OF_NOW: _lie_of_now,
    "radio lies: plan": _lie_of_plan,
    "radio replayed": _replayed,
}
OF_SENSOR_ALONE = (FROZEN_1, FROZEN_5, COASTING, SCALED, TWO)
"""Families in which a range sensor alone shows nothing for a time, or forgets what it showed."""

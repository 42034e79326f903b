"""Measured scenes: what a lead vehicle did, and what the real vehicle behind it did in the same seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.measured_cycles import evenly, longest_known, write_drive
from studies.validation import excerpts
from studies.validation.excerpts import Drive, Driver

from iptm_core.errors import MeasurementError
from iptm_core.metrics.following import MOVING_M_S
from iptm_core.state import FloatArray

SCENES = 40
SHORTEST_S, LONGEST_S = 60, 150
AFTERWARDS_S = 30
"""The drive of the lead vehicle goes on for this long after the scene, as far as it was measured."""
JOINT = (0.3, 0.3, 3.0)
"""Largest differences between two like instants: speeds of both in m/s, gap in m."""
RUN_IN_S = 40
RUN_IN_M_S2 = 1.0
STANDING_M_S = 0.5
STANDING_BEFORE_S = 5
SLOWEST_MEAN_M_S = 3.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A lead vehicle and the real vehicle behind it at steps of a second; arrays of shape (n,).

    Both begin with a run-in from standstill, unless the lead vehicle stood.

    Attributes:
        name: unique name.
        run_in_s: length of the run-in, 0 for none; not measured.
        duration_s: until the end of the scene.
        leader_speed_m_s: speed of the lead vehicle, also after the scene.
        speed_m_s: speed of the real follower.
        gap_m: measured gap between both.
    """

    name: str
    run_in_s: int
    duration_s: int
    leader_speed_m_s: FloatArray
    speed_m_s: FloatArray
    gap_m: FloatArray

    @property
    def headways_s(self) -> FloatArray:
        """Time headways of the real follower above `MOVING_M_S` in the measured seconds."""
        moving = self.speed_m_s > MOVING_M_S
        moving[: self.run_in_s] = False
        return self.gap_m[moving] / self.speed_m_s[moving]

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the real follower in the measured seconds."""
        return float(self.speed_m_s[self.run_in_s :].mean())

    def write(self, folder: Path) -> str:
        """Write the drive of the lead vehicle; returns the path as a cycle of a run."""
        return str(write_drive(folder / f"{self.name}.csv", 1.0, self.leader_speed_m_s))

    @property
    def states(self) -> FloatArray:
        """Both speeds and the gap in the measured seconds, shape (n, 3)."""
        part = slice(self.run_in_s, self.duration_s + 1)
        return np.column_stack(
            (self.leader_speed_m_s[part], self.speed_m_s[part], self.gap_m[part])
        )


def joined(scenes: Sequence[Scene], seconds: int) -> tuple[Scene, int]:
    """Return a long scene of several measured ones, and how many of them it has.

    The last instant of one and the first of the next are alike: both speeds and the gap differ by no more
    than `JOINT`. As little as possible is left out at the ends of both. Scenes that cannot be joined
    are left out, and where all are used up they follow once more.

    Args:
        scenes: measured scenes, the first of which gives the run-in and the name.
        seconds: length of the measured seconds.

    Raises:
        MeasurementError: they cannot be joined to that length.
    """
    first = scenes[0]
    states, used = first.states, {first.name}
    for other in [*scenes[1:], *scenes, *scenes]:
        if len(states) >= seconds + AFTERWARDS_S:
            break
        after, begin = _joint(states, other.states)
        if after:
            states = np.concatenate([states[:after], other.states[begin:]])
            used.add(other.name)
    if len(states) < seconds + AFTERWARDS_S:
        raise MeasurementError(
            f"scenes from {first.name} on make {len(states)} s; allowed: at least "
            f"{seconds + AFTERWARDS_S} s"
        )
    leader, speed, gap = states[: seconds + AFTERWARDS_S].T
    run_in = first.run_in_s
    scene = Scene(
        first.name,
        run_in,
        run_in + seconds - 1,
        np.append(first.leader_speed_m_s[:run_in], leader),
        np.append(first.speed_m_s[:run_in], speed[:seconds]),
        np.append(first.gap_m[:run_in], gap[:seconds]),
    )
    return scene, len(used)


def _joint(states: FloatArray, others: FloatArray) -> tuple[int, int]:
    """Return how many of the states are left, and where the others begin; zeros without a joint."""
    best = len(states) + len(others), 0, 0
    for begin, other in enumerate(others):
        alike = np.flatnonzero(np.all(np.abs(states - other) <= JOINT, axis=1))
        if alike.size:
            after = int(alike[-1])
            best = min(best, (len(states) - after + begin, after, begin))
    return best[1:]


def long_scenes(count: int, seconds: int) -> tuple[list[Scene], int]:
    """Return scenes that are long enough for cooling to pay, and of how many measured ones they are made.

    Args:
        count: number of scenes; measured ones that follow each other by name are joined.
        seconds: length of the measured seconds.

    Raises:
        MeasurementError: there are too few.
    """
    measured = measured_scenes(longest_s=None)
    groups = np.array_split(np.arange(len(measured)), count)
    found = [joined([measured[place] for place in group], seconds) for group in groups]
    return [scene for scene, _ in found], sum(used for _, used in found)


def measured_scenes(count: int = SCENES, longest_s: int | None = LONGEST_S) -> list[Scene]:
    """Return scenes with a real adaptive cruise control, evenly spread over all of OpenACC.

    Args:
        count: number of scenes.
        longest_s: length of a scene at most; None for no limit.

    Returns:
        The scenes, each with another lead vehicle.

    Raises:
        MeasurementError: there are fewer scenes.
    """
    scenes = [
        scene
        for item in excerpts.drives()
        if item.driver is Driver.ADAPTIVE_CRUISE_CONTROL and item.gap_m is not None
        for scene in [_scene(item, longest_s)]
        if scene is not None
    ]
    if len(scenes) < count:
        raise MeasurementError(
            f"the excerpts have {len(scenes)} scenes with an adaptive cruise control;"
            f" allowed: at least {count}"
        )
    return evenly(scenes, count)


def _scene(following: Drive, longest_s: int | None) -> Scene | None:
    """Return the beginning of the longest part that is known, None if it is of no use."""
    columns = np.array([following.leader_speed_m_s, following.speed_m_s, following.gap_m])
    per_second = round(1.0 / following.step_s)
    known = longest_known(columns)
    count = known.shape[1] // per_second
    leader, speed, gap = known[:, : count * per_second].reshape(3, count, per_second).mean(axis=2)
    departure = int(np.argmax(leader > STANDING_M_S)) if count else 0
    begin = max(departure - STANDING_BEFORE_S, 0)
    leader, speed = np.maximum(leader[begin:], 0.0), np.maximum(speed[begin:], 0.0)
    gap = gap[begin:]
    length = min(leader.size, longest_s or leader.size)
    usable = (
        length >= SHORTEST_S
        and speed[:length].mean() >= SLOWEST_MEAN_M_S
        and gap[:length].min() > 0.0
    )
    if not usable:
        return None
    run_in = RUN_IN_S if max(leader[0], speed[0]) > STANDING_M_S else 0
    if not run_in:
        leader[0] = speed[0] = 0.0  # a trip begins at rest
    return Scene(
        following.name.replace("/", "_"),
        run_in,
        run_in + length - 1,
        np.concatenate([_run_in(leader[0], run_in), leader[: length + AFTERWARDS_S]]),
        np.concatenate([_run_in(speed[0], run_in), speed[:length]]),
        np.concatenate([np.full(run_in, gap[0]), gap[:length]]),
    )


def _run_in(speed_m_s: float, seconds: int) -> FloatArray:
    """Return speeds from standstill up to a speed that is held."""
    ramp: FloatArray = np.minimum(RUN_IN_M_S2 * np.arange(seconds, dtype=np.float64), speed_m_s)
    return ramp

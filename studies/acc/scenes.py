"""Measured scenes: what a lead vehicle did, and what the real vehicle behind it did in the same seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.measured_cycles import evenly, longest_known, write_drive
from studies.validation.measurements import Drive, Driver
from studies.validation.readers.folder import excerpts, files_of, read_files

from iptm.parts import FloatArray, MeasurementError

SCENES = 40
SHORTEST_S, LONGEST_S = 60, 150
AFTERWARDS_S = 30
"""What the lead vehicle does after the scene is part of its drive, as far as it was measured."""
RUN_IN_S = 40
RUN_IN_M_S2 = 1.0
STANDING_M_S = 0.5
STANDING_BEFORE_S = 5
SLOWEST_MEAN_M_S = 3.0
HEADWAY_FROM_M_S = 5.0
"""Time headways count above this speed."""
HEADWAY_PERCENTILE = 95.0


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
    def largest_headway_s(self) -> float:
        """95th percentile of the real follower's time headway."""
        moving = self.speed_m_s > HEADWAY_FROM_M_S
        moving[: self.run_in_s] = False
        return float(np.percentile(self.gap_m[moving] / self.speed_m_s[moving], HEADWAY_PERCENTILE))

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the real follower in the measured seconds."""
        return float(self.speed_m_s[self.run_in_s :].mean())

    def write(self, folder: Path) -> str:
        """Write the drive of the lead vehicle; returns the path as a cycle of a run."""
        return str(write_drive(folder / f"{self.name}.csv", 1.0, self.leader_speed_m_s))


def measured_scenes(
    source: Path | None,
    report: Callable[[str], None],
    count: int = SCENES,
    longest_s: int = LONGEST_S,
) -> list[Scene]:
    """Return scenes with a real adaptive cruise control, evenly spread over all of OpenACC.

    Args:
        source: folder with measurements; None for the excerpts of the project.
        report: takes one line per file that was left out.
        count: number of scenes.
        longest_s: length of a scene at most.

    Returns:
        The scenes, each with another lead vehicle.

    Raises:
        MeasurementError: there are fewer scenes in the folder.
    """
    drives = read_files(files_of(source or excerpts()), report).drives
    scenes = [
        scene
        for item in drives
        if item.driver is Driver.ADAPTIVE_CRUISE_CONTROL and item.gap_m is not None
        for scene in [_scene(item, longest_s)]
        if scene is not None
    ]
    if len(scenes) < count:
        raise MeasurementError(
            f"{source or excerpts()} has {len(scenes)} scenes with an adaptive cruise control;"
            f" allowed: at least {count}"
        )
    return evenly(scenes, count)


def _scene(following: Drive, longest_s: int) -> Scene | None:
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
    length = min(leader.size, longest_s)
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

"""A vehicle whose motion is known inside its ticks: parts of constant acceleration, as it has driven them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from iptm_core.state import FloatArray, VehicleState
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

STEP_S = 0.01
"""Step at which motions are judged."""


class RecordedPlant(Plant):
    """The simulated vehicle; forget its parts before another trip.

    Attributes:
        parts: start time, position, speed, acceleration and duration of every part.
        asked_m_s2: acceleration that the present interval was begun with.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.parts: list[tuple[float, float, float, float, float]] = []

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        step = super()._drive_interval(state, report, duration_s)
        asked_m_s2 = report.actuated.acceleration_m_s2
        self.parts.append((state.time_s, state.position_m, state.speed_m_s, asked_m_s2, duration_s))
        return step

    def motion(self, first: int = 0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return times, positions, speeds and accelerations at `STEP_S`, from a part on.

        Every part begins where the one before ended; within one the acceleration is constant, to standstill.
        """
        found: list[tuple[Any, ...]] = []
        for time_s, position_m, speed_m_s, acceleration_m_s2, duration_s in self.parts[first:]:
            last = math.ceil((time_s + duration_s) / STEP_S - 1e-6)
            times_s = STEP_S * np.arange(math.ceil(time_s / STEP_S - 1e-6), last)
            elapsed_s = times_s - time_s
            if speed_m_s <= 0.0 and acceleration_m_s2 <= 0.0:
                elapsed_s = np.zeros(elapsed_s.size)
            elif acceleration_m_s2 < 0.0:
                elapsed_s = np.minimum(elapsed_s, speed_m_s / -acceleration_m_s2)
            moved_m = elapsed_s * (speed_m_s + 0.5 * acceleration_m_s2 * elapsed_s)
            speeds_m_s = speed_m_s + acceleration_m_s2 * elapsed_s
            accelerations = np.full(times_s.size, acceleration_m_s2)
            found.append((times_s, position_m + moved_m, speeds_m_s, accelerations))
        columns = [np.concatenate(each) for each in zip(*found, strict=True)]
        return columns[0], columns[1], columns[2], columns[3]

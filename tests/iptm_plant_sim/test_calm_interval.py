"""Intervals in which the monitor need not look closer are judged in C as in Python, to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_plant_sim.scenes import PARAMETERS, driving

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.state import Command, LeaderPreview, VehicleState
from iptm_plant_sim import calm_interval
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.service_braking import RangeSensor

TRIPS, INTERVALS = 100, 100
HARDEST_M_S2 = (0.0, 0.4, 1.0, 2.5, 5.0, 8.0)


class RandomLead:
    """A vehicle ahead that drives and stops at random, and its range sensor that fails now and then."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._gap_m, self._speed_m_s = rng.uniform(5.0, 80.0), rng.choice([0.0, 12.0, 25.0])
        self._period_s = rng.choice([0.1, 0.1, 0.1, 0.05, 0.25])
        self._fails = rng.choice([0.0, 0.02, 0.1])
        self._grip = HARDEST_M_S2[rng.integers(len(HARDEST_M_S2))]

    def measure(self, state: VehicleState) -> LeaderPreview | None:
        """Return the measurements of an interval of a second."""
        rng, times_s = self._rng, np.arange(0.0, 1.0 - 1e-9, self._period_s)
        if state.time_s == 0.0:
            self._position_m = state.position_m + self._gap_m
        a = rng.choice([0.0, 0.0, rng.uniform(-self._grip, 1.5)])
        speeds_m_s = np.maximum(self._speed_m_s + a * times_s, 0.0)
        steps_m = 0.5 * (speeds_m_s[1:] + speeds_m_s[:-1]) * self._period_s
        positions_m = self._position_m + np.concatenate(([0.0], np.cumsum(steps_m)))
        self._position_m = positions_m[-1] + speeds_m_s[-1] * self._period_s
        self._speed_m_s = max(self._speed_m_s + a, 0.0)
        measured = LeaderPreview(state.time_s + times_s, positions_m, speeds_m_s)
        if rng.random() < self._fails:
            return self._failed(measured)
        return measured

    def _failed(self, measured: LeaderPreview) -> LeaderPreview | None:
        columns = np.array([measured.times_s, measured.positions_m, measured.speeds_m_s])
        way = self._rng.integers(8)
        if way == 0:
            return None
        if way == 1:
            return LeaderPreview.empty()
        if way == 2:  # late, and in columns that are not contiguous
            columns = columns.T[3:].T
        elif way == 3:  # repeats itself
            columns[1:, 4:] = columns[1:, 3:4]
        elif way == 4:  # another vehicle
            columns[1, 5:] -= 10.0
        elif way == 5:
            columns[2, 2:] += 5.0
        elif way == 6:  # repeats itself but for noise
            columns[1, 3:] = columns[1, 2] + 5e-7 * np.arange(columns.shape[1] - 3)
            columns[2, 3:] = columns[2, 2]
        else:
            columns[self._rng.integers(1, 3), 2] = np.nan
        return LeaderPreview(*columns)


def watched(sensor: RangeSensor, settings: SafetyMonitorSettings, friction: float) -> Plant:
    plant = Plant(PARAMETERS, lambda places_m: 0.03 * np.sin(0.01 * places_m), safety=settings)
    plant.road_friction = friction
    plant.watch(sensor)
    return plant


def digits(step: PlantStep) -> str:
    """Return all numbers of a step to the last digit, NaN included."""
    lead = step.memory.lead
    lead = replace(lead, recent=tuple(map(tuple, lead.recent)))
    return repr(replace(step, memory=replace(step.memory, lead=lead)))


def test_ten_thousand_intervals_are_those_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = calm_interval.CalmInterval.judged
    answers: list[bool] = []

    def counted(*given: object, **named: object) -> object:
        found = judged(*given, **named)  # type: ignore[arg-type]
        answers.append(found is not None)
        return found

    monkeypatch.setattr(calm_interval.CalmInterval, "judged", counted)
    for trip in range(TRIPS):
        rng = np.random.default_rng(trip)
        friction = float(rng.choice([0.0, 0.3]))
        stated = float(rng.choice([0.0, 0.0, 0.9]))
        settings = SafetyMonitorSettings(road_friction=stated, gap_accuracy_m=float(trip % 3))
        leads = [RandomLead(np.random.default_rng(1000 + trip)) for _ in range(2)]
        in_c = watched(leads[0].measure, settings, friction)
        with monkeypatch.context() as without:
            without.setattr("iptm_plant_sim.plant.calm_interval", lambda *_: None)
            in_python = watched(leads[1].measure, settings, friction)
        _, state = driving(float(rng.choice([0.0, 8.0, 20.0])))
        for _ in range(INTERVALS):
            command = Command(float(rng.choice([0.0, -0.4, rng.uniform(-1.5, 1.0)])), 300.0)
            step, expected = in_c.advance(state, command), in_python.advance(state, command)
            assert digits(step) == digits(expected), f"trip {trip} at {state.time_s} s"
            state = step.state
    assert answers.count(True) > 0.3 * TRIPS * INTERVALS
    assert answers.count(False) > 0.03 * TRIPS * INTERVALS

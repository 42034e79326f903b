"""A vehicle whose commands come late, whose brakes are weak, or that drives on a worse road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from iptm.faults.fault import Fault
from iptm.faults.injection import FaultyPlant
from iptm.faults.kinds import FaultKind
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, LeaderPreview

PARAMETERS = load_parameters().values


def actuated(fault: Fault, accelerations_m_s2: list[float]) -> list[float]:
    """Drive a vehicle at 20 m/s by commands and return what it carried out."""
    plant = FaultyPlant([fault], PARAMETERS, np.zeros_like)
    state = plant.initial_state(speed_m_s=20.0)
    done = []
    for acceleration in accelerations_m_s2:
        step = plant.advance(state, Command(acceleration, 0.0))
        done.append(step.report.actuated.acceleration_m_s2)
        state = step.state
    return done


def test_delayed_commands_act_later() -> None:
    commands = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    fault = Fault(FaultKind.COMMAND_DELAYED, 2.0, 3.0, size=2.0)
    assert actuated(fault, commands) == [0.1, 0.2, 0.1, 0.2, 0.3, 0.6]


def test_weak_brakes_reach_their_share() -> None:
    fault = Fault(FaultKind.BRAKES_WEAK, 0.0, 100.0, size=0.7)
    hardest = PARAMETERS.limits.min_acceleration_m_s2
    assert min(actuated(fault, [-10.0] * 10)) == pytest.approx(0.7 * hardest)


def test_a_slippery_road_and_a_steeper_one_take_what_brakes_can_do() -> None:
    faults = [
        Fault(FaultKind.ROAD_SLIPPERY, 0.0, 2.0, size=0.3),
        Fault(FaultKind.ROAD_STEEPER, 1.0, 1.0, size=-0.1),
    ]
    plant = FaultyPlant(faults, PARAMETERS, np.zeros_like)
    state = replace(plant.initial_state(), speed_m_s=30.0)
    ahead = LeaderPreview(np.array([0.0]), np.array([5.0]), np.array([0.0]))
    plant.watch(lambda now: replace(ahead, times_s=np.array([now.time_s])))
    hardest = []
    for _ in range(3):
        step = plant.advance(state, Command(0.0, 0.0))
        state = step.state
        hardest.append(-state.acceleration_m_s2)
    down = 9.81 * np.sin(0.1)
    assert hardest == pytest.approx([2.943, 2.943 * np.cos(0.1) - down, 8.0])

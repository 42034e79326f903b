"""What tests share: property tests that are repeatable and do not judge by the clock; messages of a tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import settings

from iptm_core.state import IntervalPowers, LeaderState, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_interfaces.codecs import (
    encode_acceleration,
    encode_capacity_loss,
    encode_host_odometry,
    encode_leader,
    encode_powers,
    encode_temperature,
)
from iptm_interfaces.topics import Topic

# The same examples in every run, and no deadline: a busy machine must not fail a test.
settings.register_profile("iptm", deadline=None, derandomize=True)
settings.load_profile("iptm")


@pytest.fixture
def tick_messages() -> Callable[[Trajectory, int], dict[Topic, Any]]:
    """Return what plant and bridge publish in one row of a trajectory, by topic."""
    return _tick_messages


def _tick_messages(run: Trajectory, row: int) -> dict[Topic, Any]:
    values = {name: float(column[row]) for name, column in run.to_arrays().items()}
    time_s = values["time_s"]
    state = VehicleState(**{name: values[name] for name in VehicleState.__dataclass_fields__})
    powers = IntervalPowers(**{name: values[name] for name in IntervalPowers.__dataclass_fields__})
    leader = LeaderState(time_s, values["leader_position_m"], values["leader_speed_m_s"])
    temperatures = ("cell_1", "cell_n", "coolant_inlet", "coolant_outlet")
    return {
        **{
            Topic(f"plant/{name}_temperature"): encode_temperature(
                time_s, values[f"{name}_temperature_k"]
            )
            for name in temperatures
        },
        Topic.PLANT_POWERS: encode_powers(time_s, powers),
        Topic.PLANT_CAPACITY_LOSS: encode_capacity_loss(state),
        Topic.PLANT_ACCELERATION: encode_acceleration(state),
        Topic.PLANT_ODOMETRY: encode_host_odometry(state),
        Topic.LEADER: encode_leader(leader),
    }

"""The cabin over DDS: a plant node with a cabin publishes it with every state, with standard messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState, Temperature

import iptm
from iptm_cabin.cabin_plant import CABIN, plant_with
from iptm_cabin.extra_plant_topics import STATE_TOPIC, TEMPERATURE_TOPIC, publisher
from iptm_cabin.parameters import CabinParameters
from iptm_cabin.trips import drive_with_cabin
from iptm_core.parameters import load_parameters
from iptm_core.state import Command
from iptm_plant_sim.plant import Plant
from iptm_ros.publishers import STREAM_QOS

LAUNCHED = {"cycle": "us06", "plant": "mid_size.cabin", "start_paused": False}


def test_the_cabin_of_a_step_is_heard(peer: Any) -> None:
    cabins: list[JointState] = []
    warmths: list[Temperature] = []
    peer.node.create_subscription(JointState, STATE_TOPIC, cabins.append, STREAM_QOS)
    peer.node.create_subscription(Temperature, TEMPERATURE_TOPIC, warmths.append, STREAM_QOS)
    car = load_parameters("paper_calibrated").values
    assert publisher(peer.node, Plant(car, np.zeros_like)) is None
    plant = plant_with(CabinParameters(initial_c=5.0))(car, np.zeros_like)
    publish = publisher(peer.node, plant)
    assert publish is not None
    names = {peer.node.resolve_topic_name(name) for name in (STATE_TOPIC, TEMPERATURE_TOPIC)}
    own = [each for each in peer.node.publishers if each.topic_name in names]
    assert len(own) == len(names)
    peer.wait_until(
        lambda: all(each.get_subscription_count() for each in own), what="both listeners"
    )
    step = plant.advance(plant.initial_state(), Command(0.0, 0.0))
    publish(step)
    peer.wait_until(lambda: cabins and warmths, what="the cabin of the step")
    found = dict(zip(cabins[0].name, cabins[0].position, strict=True))
    assert tuple(found) == CABIN
    assert found["electric_w"] > 1000.0
    assert warmths[0].temperature == pytest.approx(found["air_k"] - 273.15)
    assert warmths[0].header.stamp.sec == cabins[0].header.stamp.sec == 1


def test_a_plant_node_publishes_it(launcher: Any, peer: Any) -> None:
    cabins: list[JointState] = []
    peer.node.create_subscription(JointState, STATE_TOPIC, cabins.append, STREAM_QOS)
    launcher.start_node("iptm_plant_sim.node", parameters=LAUNCHED)
    command = peer.node.create_publisher(JointState, "controller/command", STREAM_QOS)
    peer.wait_until(lambda: cabins, what="the cabin of the first state")
    assert tuple(cabins[0].name) == CABIN
    assert command.topic_name.endswith("controller/command")


def test_the_bag_of_a_run_has_the_cabin_and_its_energy(tmp_path: Path) -> None:
    trip = iptm.Trip.of(
        "us06", duration_s=20.0, plant="mid_size.cabin", strategy="production", climate=-5.0
    )
    run = iptm.drive(trip, over="ros", bag=str(tmp_path / "bag"))
    assert not run.problems
    assert run.bag_messages is not None
    for name in (
        STATE_TOPIC,
        TEMPERATURE_TOPIC,
    ):  # a state may be repeated, and the last one come late
        assert run.bag_messages[f"/{name}"] >= len(run.trajectory) - 1
    in_memory, table = drive_with_cabin(
        "us06", "mid_size.cabin", duration_s=20.0, strategy="production", climate=-5.0
    )
    electric_j = float(table.electric_w.iloc[1:].sum())
    for each in (run, in_memory):
        assert each.energies.consumers_j == pytest.approx(electric_j)
        assert each.energies.uses["consumers"] == each.energies.consumers_j
        assert abs(each.energies.residual) < 1e-6

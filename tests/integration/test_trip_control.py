"""Services of plant and controller: pause, resume, step, reset, and saved states to start from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.integration.driven_plant import driven_plant, lively
from tests.integration.node_bench import S

from iptm_core.settings import ThermalModel
from iptm_core.state import Command
from iptm_ros.codecs import decode_command, ns_from_time
from iptm_ros.diagnostics import Level
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_trajectory, trip_starts_ns
from iptm_ros.services import Service
from iptm_ros.topics import Topic

PAUSED = (Level.WARN, "paused by request")
PLANT, BRIDGE, CONTROLLER = "iptm_plant_sim.node", "iptm_v2x_bridge.node", "iptm_controller.node"
LINK: dict[str, object] = {
    "noise_std_m_s": 1.0,
    "latency_s": 3.0,
    "dropout_probability": 0.4,
    "dropout_burst": 4,
}
FIRST_TICKS = 15

pytestmark = pytest.mark.usefixtures("ros_environment")


def test_lock_step_pauses_steps_and_goes_on() -> None:
    with driven_plant(duration_s=60.0, start_paused=True, command_timeout_wall_s=0.5) as plant:
        bench = plant.bench
        assert bench.call(Service.STEP).message == "leads to the first state"
        # The controller's answer is there, its timeout has long passed, and nothing moves.
        plant.drive(lively, lambda: len(plant.ticks) >= 3)
        assert set(plant.ticks) == {0}
        assert bench.situation == PAUSED
        for tick in (1, 2, 3):
            assert bench.call(Service.STEP).success
            plant.drive(lively, lambda tick=tick: plant.ticks[-1] == tick * S)
        plant.drive(lively, lambda: plant.ticks.count(3 * S) >= 2)
        answer = bench.call(Service.RESUME)
        assert (answer.success, answer.message) == (True, "goes on from 3 s")
        plant.drive(lively)
        assert sorted(set(plant.ticks)) == [tick * S for tick in range(61)]
        assert (bench.values["ignored_commands"], bench.values["controller_losses"]) == ("0", "0")


def test_a_reset_repeats_the_trip() -> None:
    with driven_plant(duration_s=30.0, at_end="wait") as plant:

        def is_finished() -> bool:
            return plant.bench.values["phase"] == "finished"

        plant.drive(lively, is_finished)
        first = plant.states()
        for service in (Service.PAUSE, Service.RESUME, Service.STEP):
            answer = plant.bench.call(service)
            assert not answer.success
            assert "finished" in answer.message
        assert plant.bench.call(Service.RESET).success
        plant.drive(lively, lambda: is_finished() and plant.ticks.count(30 * S) == 2)
        assert plant.ticks == 2 * [tick * S for tick in range(31)]
        assert plant.states() == 2 * first


def test_real_time_pauses_between_ticks_without_overruns() -> None:
    pace = {"mode": "real_time", "rate_factor": 5.0, "clock_hz": 50.0, "command_timeout_s": 60.0}
    with driven_plant(**pace) as plant:
        bench = plant.bench

        def drive(until: Callable[[], object]) -> None:
            plant.drive(lambda _: Command(0.1, 0.0), until)

        drive(lambda: plant.ticks and plant.ticks[-1] >= 3 * S)
        assert bench.call(Service.PAUSE).message == "pauses at the next state"
        drive(lambda: bench.situation == PAUSED)
        at_ns = plant.ticks[-1]
        assert at_ns % S == 0
        drive(lambda: plant.ticks.count(at_ns) >= 2)
        assert bench.call(Service.STEP).success
        drive(lambda: plant.ticks.count(at_ns + S) >= 2)
        assert plant.ticks[-1] == at_ns + S
        assert bench.call(Service.RESUME).success
        drive(lambda: plant.ticks[-1] >= at_ns + 3 * S)
        # Time never ran back, and no node was reported as lost.
        assert plant.ticks == sorted(plant.ticks)
        assert bench.values["controller_losses"] == "0"


@pytest.mark.parametrize("service", [Service.STEP, Service.RESET])
def test_a_request_that_does_not_fit_is_refused_in_a_sentence(service: Service) -> None:
    with driven_plant(start_paused=False) as plant:
        answer = plant.bench.call(service)
    assert not answer.success
    assert "waiting" in answer.message
    assert "allowed" in answer.message


@pytest.mark.parametrize("thermal_model", list(ThermalModel))
def test_the_plant_continues_from_a_saved_state_to_the_last_bit(
    tmp_path: Path, thermal_model: ThermalModel
) -> None:
    options = {
        "duration_s": 50.0,
        "thermal_model": thermal_model.value,
        "state_folder": tmp_path / "states",
    }
    with driven_plant(**options) as plant:
        plant.drive(
            lambda tick: None if tick == 20 else lively(tick), lambda: plant.ticks[-1:] == [20 * S]
        )
        assert plant.bench.call(Service.SAVE_PLANT).success
        plant.answer(20, lively(20))
        plant.drive(lively)
        whole = plant.states()
    (file,) = (tmp_path / "states").iterdir()
    assert file.name == "plant_20s.json"
    with driven_plant(**options, start_state=file) as plant:
        plant.drive(lively)
        assert plant.ticks == [tick * S for tick in range(20, 51)]
        assert plant.states() == whole[20:]


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "cannot be read"), ("{}", "not a state file"), ("[1", "cannot be read")],
)
def test_a_file_that_holds_no_state_is_refused_in_one_line(
    refused: Callable[..., str], tmp_path: Path, content: str | None, words: str
) -> None:
    file = tmp_path / "state.json"
    if content is not None:
        file.write_text(content)
    assert words in refused(PLANT, parameters={"start_state": file})


def call(peer: Any, service: Service) -> None:
    """Call a service of a running node; it is expected to succeed."""
    answer = peer.call(service.value)
    assert answer.success, answer.message


def test_the_nodes_sit_out_a_pause_and_repeat_a_trip_after_a_reset_and_from_saved_states(
    launcher: Any, peer: Any, tmp_path: Path
) -> None:
    """All nodes as processes: a trip that is paused and saved, again, and its rest from the files."""
    clocks: list[int] = []
    commands: dict[int, Command] = {}

    def note(message: Any) -> None:
        stamp_ns, command = decode_command(message)
        commands[stamp_ns] = command

    peer.node.listen(Topic.COMMAND, note)
    # Subscribed to after the commands: a node whose status arrives is matched for its commands as well.
    statuses = {name: peer.statuses(f"/{name}") for name in ("plant", "controller", "v2x_bridge")}
    peer.node.listen(Topic.PLANT_STATE, lambda _: None)
    peer.node.listen(Topic.CLOCK, lambda message: clocks.append(ns_from_time(message.clock)))
    states = {"state_folder": tmp_path / "states"}
    controller = {**states, "horizon": "2x1+2x5+2x30t"}
    plant = {**states, "duration_s": 1e6, "command_timeout_wall_s": 120.0}
    recorder = launcher.start_module("iptm_ros.recording.recorder_cli", tmp_path / "bag")
    nodes = [launcher.start_node(CONTROLLER, parameters=controller)]
    # A command published before this node is matched would be lost to it.
    peer.wait_until(lambda: bool(statuses["controller"]), what="a status of the controller")
    nodes += [
        launcher.start_node(BRIDGE, parameters=LINK),
        launcher.start_node(PLANT, parameters={**plant, "start_paused": True}),
    ]
    peer.begin("plant", "v2x_bridge", "controller", "recorder")
    peer.wait_until(lambda: len(commands) > FIRST_TICKS, what="the trip under way")
    call(peer, Service.PAUSE)
    # Longer than the nodes wait for messages, by the plant's own count of its repeated states.
    heard = len(clocks)
    peer.wait_until(lambda: len(clocks) >= heard + 6, what="six repeated states")
    assert len(set(clocks[heard + 1 :])) == 1
    assert statuses["plant"][-1].message == PAUSED[1]
    for name in ("controller", "v2x_bridge"):
        assert not any("stopped" in status.message for status in statuses[name][-5:]), name
        assert all(status.level != Level.STALE.value for status in statuses[name])
    saved_ns = clocks[-1]
    peer.wait_until(lambda: saved_ns in commands, what="the answer to the present state")
    for service in (Service.SAVE_PLANT, Service.SAVE_CONTROLLER, Service.RESUME):
        call(peer, service)
    last_ns = saved_ns + 20 * S
    peer.wait_until(lambda: last_ns in commands, what="the rest of the trip")
    whole = dict(commands)

    call(peer, Service.PAUSE)
    commands.clear()
    call(peer, Service.RESET)
    peer.wait_until(lambda: 0 in commands, what="the new trip at its start, paused")
    call(peer, Service.RESUME)
    peer.wait_until(lambda: FIRST_TICKS * S in commands, what="the new trip under way")
    for tick in range(FIRST_TICKS):
        assert commands[tick * S] == whole[tick * S], tick
    for process in (recorder, *nodes):
        assert process.stop() == 0
    with BagReader(tmp_path / "bag") as reader:
        assert len(trip_starts_ns(reader)) == 2
    trajectory = read_trajectory(tmp_path / "bag")
    assert trajectory.time_s[0] == 0.0
    assert len(trajectory) >= FIRST_TICKS

    at = f"{saved_ns / S:g}"
    files = {name: tmp_path / "states" / f"{name}_{at}s.json" for name in ("plant", "controller")}
    statuses["controller"].clear()
    launcher.start_node(CONTROLLER, parameters={**controller, "start_state": files["controller"]})
    # Late messages of the previous nodes arrive before this status, and are discarded.
    peer.wait_until(
        lambda: any("waiting" in status.message for status in statuses["controller"]),
        60.0,
        "a status of the new controller",
    )
    commands.clear()
    link = {**LINK, "start_time_s": float(at)}
    launcher.start_node(BRIDGE, parameters=link)
    launcher.start_node(
        PLANT, parameters={**plant, "start_paused": True, "start_state": files["plant"]}
    )
    peer.begin("plant", "v2x_bridge", "controller")
    peer.wait_until(lambda: last_ns in commands, what="the rest of the trip once more")
    for stamp_ns in range(saved_ns, last_ns + 1, S):
        assert commands[stamp_ns] == whole[stamp_ns], stamp_ns

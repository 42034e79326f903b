"""Pause, resume, step and reset of the plant by its services: the plant alone, and the whole ring."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from tests.integration.plant_driver import Driver, S, call, lively, start

from iptm_core.state import Command
from iptm_interfaces.codecs import decode_command, ns_from_time
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.services import Service
from iptm_interfaces.topics import Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.trajectory_reader import read_trajectory, trip_starts_ns

PAUSED = "paused by request"
RING: dict[str, dict[str, object]] = {
    "iptm_controller.node": {"horizon": "2x1+2x5", "compile_code": False},
    "iptm_v2x_bridge.node": {"expected_peers": 2, "noise_std_m_s": 1.0},
    "iptm_plant_sim.node": {
        "duration_s": 1e6,
        "command_timeout_wall_s": 60.0,
        "expected_peers": 3,  # the recorder and the node of the test are two of them
    },
}


def wait_for_repeats(driver: Driver, count: int) -> None:
    """Wait until the plant has repeated its state so often since now."""
    wanted = int(driver.values()["repeated_states"]) + count
    driver.wait(lambda: int(driver.values()["repeated_states"]) >= wanted, "the state repeated")


def test_lock_step_pauses_steps_and_goes_on(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lively)
    process = start(launcher, duration_s=60.0, start_paused=True, command_timeout_wall_s=0.5)
    driver.wait(lambda: PAUSED in driver.reasons(), "the pause")
    # The controller's answer is there, its timeout has long passed, and nothing moves.
    wait_for_repeats(driver, 2)
    assert set(driver.ticks) == {0}
    assert driver.statuses[-1].level == Level.WARN.value
    for tick in (1, 2, 3):
        assert call(peer, Service.STEP).success
        driver.wait(lambda tick=tick: driver.has_all(tick * S), f"the state of tick {tick}")
    wait_for_repeats(driver, 1)
    assert max(driver.ticks) == 3 * S
    answer = call(peer, Service.RESUME)
    assert answer.success
    assert answer.message == "goes on from 3 s"
    assert driver.end(process) == 0
    assert sorted(set(driver.ticks)) == [tick * S for tick in range(61)]
    values = driver.values()
    assert (values["ignored_commands"], values["controller_losses"]) == ("0", "0")


def test_a_reset_repeats_the_trip_and_keeps_the_pause(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lively)
    process = start(launcher, duration_s=30.0, at_end="wait", command_timeout_wall_s=60.0)
    driver.wait(lambda: driver.phases()[-1:] == ["finished"], "the end of the first trip")
    driver.wait(lambda: driver.has_all(30 * S), "the last state of the first trip")
    first = {stamp: driver.state(stamp) for stamp in set(driver.ticks)}
    for service in (Service.PAUSE, Service.RESUME, Service.STEP):
        answer = call(peer, service)
        assert not answer.success
        assert "finished" in answer.message
    driver.ticks.clear()
    assert call(peer, Service.RESET).success
    driver.wait(lambda: driver.has_all(30 * S), "the end of the second trip")
    driver.wait(
        lambda: driver.phases()[-1:] == ["finished"], "the second trip reported as finished"
    )
    assert driver.ticks == [tick * S for tick in range(31)]
    assert {stamp: driver.state(stamp) for stamp in driver.ticks} == first
    assert process.stop() == 0


def test_real_time_pauses_between_ticks_without_overruns(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda _: None)
    clocks: list[int] = []

    def answer(message: Any) -> None:
        clocks.append(ns_from_time(message.clock))
        if clocks[-1] % S == 0:
            driver.send(clocks[-1], Command(0.1, 0.0))

    peer.node.listen(Topic.CLOCK, answer)
    process = start(
        launcher, mode="real_time", rate_factor=5.0, clock_hz=50.0, command_timeout_s=60.0
    )
    driver.wait(lambda: driver.ticks and driver.ticks[-1] >= 3 * S, "a trip under way")
    assert call(peer, Service.PAUSE).message == "pauses at the next state"
    driver.wait(lambda: driver.phases()[-1:] == ["paused"], "the pause")
    wait_for_repeats(driver, 2)
    at_ns = clocks[-1]
    assert at_ns % S == 0
    assert call(peer, Service.STEP).success
    driver.wait(lambda: clocks[-1] == at_ns + S, "the next state")
    wait_for_repeats(driver, 1)
    assert clocks[-1] == at_ns + S
    assert call(peer, Service.RESUME).success
    driver.wait(lambda: clocks[-1] >= at_ns + 3 * S, "the trip going on")
    # Time never ran back, and no node was reported as lost.
    assert all(later >= earlier for earlier, later in pairwise(clocks))
    assert driver.values()["controller_losses"] == "0"
    assert process.stop() == 0


def test_the_ring_sits_out_a_pause_and_repeats_a_trip_after_a_reset(
    launcher: Any, peer: Any, tmp_path: Path
) -> None:
    clocks: list[int] = []
    commands: dict[int, Command] = {}
    statuses = {name: peer.statuses(f"/{name}") for name in ("plant", "controller", "v2x_bridge")}

    def note(message: Any) -> None:
        stamp_ns, command = decode_command(message)
        commands[stamp_ns] = command

    peer.node.listen(Topic.CLOCK, lambda message: clocks.append(ns_from_time(message.clock)))
    peer.node.listen(Topic.PLANT_ODOMETRY, lambda _: None)
    peer.node.listen(Topic.COMMAND, note)
    recorder = launcher.start_module("iptm_recording.recorder_cli", tmp_path / "bag")
    for module, parameters in RING.items():
        launcher.start_node(module, parameters=parameters)
    peer.wait_until(lambda: len(commands) > 25, 120.0, "the trip under way")
    assert call(peer, Service.PAUSE).success
    # Twice the patience of everybody else, by the plant's own count of its signs of life.
    heard = len(clocks)
    peer.wait_until(lambda: len(clocks) >= heard + 10, 60.0, "ten signs of life")
    assert len(set(clocks[heard:])) == 1
    reasons = {
        name: {status.message for status in reported[-5:]} for name, reported in statuses.items()
    }
    assert reasons["plant"] == {PAUSED}
    for name in ("controller", "v2x_bridge"):
        assert not any("stopped" in reason for reason in reasons[name]), reasons
        assert all(status.level != Level.STALE.value for status in statuses[name])
    first = dict(commands)
    commands.clear()
    assert call(peer, Service.RESET).success
    peer.wait_until(lambda: 0 in commands, 60.0, "the new trip at its start, paused")
    assert call(peer, Service.RESUME).success
    peer.wait_until(lambda: len(commands) > 25, 120.0, "the new trip under way")
    assert all(commands[tick * S] == first[tick * S] for tick in range(25))
    assert recorder.stop() == 0
    with BagReader(tmp_path / "bag") as reader:
        assert len(trip_starts_ns(reader)) == 2
    trajectory = read_trajectory(tmp_path / "bag")
    assert trajectory.time_s[0] == 0.0
    assert len(trajectory) >= 25


@pytest.mark.parametrize("service", [Service.STEP, Service.RESET])
def test_what_cannot_be_done_now_is_refused_in_a_sentence(
    launcher: Any, peer: Any, service: Service
) -> None:
    start(launcher, expected_peers=5)
    answer = call(peer, service)
    assert not answer.success
    assert "waiting" in answer.message
    assert "allowed" in answer.message

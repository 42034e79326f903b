"""A trip that starts from saved states goes on as the one that was never stopped, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.integration.plant_driver import Driver, S, call, lively, start

from iptm_core.settings import ThermalModel
from iptm_core.state import Command
from iptm_interfaces.codecs import decode_command, ns_from_time
from iptm_interfaces.services import Service
from iptm_interfaces.topics import Topic

PLANT, BRIDGE, CONTROLLER = "iptm_plant_sim.node", "iptm_v2x_bridge.node", "iptm_controller.node"
HORIZON = "2x1+2x5+2x30t"
LINK: dict[str, object] = {
    "expected_peers": 1,
    "noise_std_m_s": 1.0,
    "latency_s": 3.0,
    "dropout_probability": 0.4,
    "dropout_burst": 4,
}


@pytest.mark.parametrize("thermal_model", list(ThermalModel))
def test_the_plant_goes_on_to_the_last_bit(
    launcher: Any, peer: Any, tmp_path: Path, thermal_model: ThermalModel
) -> None:
    options: dict[str, object] = {
        "duration_s": 50.0,
        "thermal_model": thermal_model.value,
        "state_folder": tmp_path / "states",
    }
    whole = Driver(peer, lambda tick: None if tick == 20 else lively(tick))
    process = start(launcher, **options)
    whole.wait(lambda: whole.has_all(20 * S), "the state to be saved")
    assert call(peer, Service.SAVE_PLANT).success
    whole.send(20 * S, lively(20))
    assert whole.end(process) == 0
    whole.script = lambda _: None
    (file,) = (tmp_path / "states").iterdir()
    assert file.name == "plant_20s.json"

    rest = Driver(peer, lively)
    process = start(launcher, **options, start_state=file)
    assert rest.end(process) == 0
    assert sorted(set(rest.ticks)) == [tick * S for tick in range(20, 51)]
    for stamp_ns in rest.ticks:
        assert rest.state(stamp_ns) == whole.state(stamp_ns), stamp_ns


def test_the_ring_goes_on_to_the_last_bit(launcher: Any, peer: Any, tmp_path: Path) -> None:
    states = {"state_folder": tmp_path / "states"}
    plant: dict[str, object] = {
        **states,
        "duration_s": 1e6,
        "expected_peers": 2,
        "command_timeout_wall_s": 120.0,
    }
    controller: dict[str, object] = {**states, "horizon": HORIZON, "compile_code": False}
    commands: dict[int, Command] = {}
    clocks: list[int] = []

    def note(message: Any) -> None:
        stamp_ns, command = decode_command(message)
        commands[stamp_ns] = command

    heard_commands = peer.node.listen(Topic.COMMAND, note)
    peer.node.listen(Topic.PLANT_ODOMETRY, lambda _: None)
    peer.node.listen(Topic.CLOCK, lambda message: clocks.append(ns_from_time(message.clock)))
    ring = [
        launcher.start_node(CONTROLLER, parameters=controller),
        launcher.start_node(BRIDGE, parameters=LINK),
        launcher.start_node(PLANT, parameters=plant),
    ]
    peer.wait_until(lambda: len(commands) > 15, 120.0, "the trip under way")
    assert call(peer, Service.PAUSE).success
    heard = len(clocks)
    peer.wait_until(lambda: len(clocks) > heard + 1, what="the state repeated")
    saved_ns = clocks[-1]
    peer.wait_until(lambda: saved_ns in commands, what="the answer to the present state")
    for service in (Service.SAVE_PLANT, Service.SAVE_CONTROLLER):
        answer = call(peer, service)
        assert answer.success, answer.message
    assert call(peer, Service.RESUME).success
    last_ns = saved_ns + 20 * S
    peer.wait_until(lambda: last_ns in commands, 120.0, "the rest of the trip")
    for process in ring:
        assert process.stop() == 0
    whole = dict(commands)
    commands.clear()

    at = f"{saved_ns / S:g}"
    plant["start_state"] = tmp_path / "states" / f"plant_{at}s.json"
    controller["start_state"] = tmp_path / "states" / f"controller_{at}s.json"
    peer.wait_until(
        lambda: not heard_commands.get_publisher_count(), 60.0, "the end of the first trip"
    )
    launcher.start_node(CONTROLLER, parameters=controller)
    # The plant does not wait until this subscriber and the new publisher of commands are matched.
    peer.wait_until(heard_commands.get_publisher_count, 60.0, "the publisher of commands")
    launcher.start_node(BRIDGE, parameters={**LINK, "start_time_s": float(at)})
    launcher.start_node(PLANT, parameters=plant)
    peer.wait_until(lambda: last_ns in commands, 120.0, "the rest of the trip once more")
    for stamp_ns in range(saved_ns, last_ns + 1, S):
        assert commands[stamp_ns] == whole[stamp_ns], stamp_ns


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "cannot be read"), ("{}", "not a state file"), ("[1", "cannot be read")],
)
def test_a_file_that_holds_no_state_is_refused_in_one_line(
    launcher: Any, tmp_path: Path, content: str | None, words: str
) -> None:
    file = tmp_path / "state.json"
    if content is not None:
        file.write_text(content)
    start(launcher, start_state=file).assert_refused(words)

"""Any node may be killed and started again: it takes part in the trip again, in lock-step as well."""

from __future__ import annotations

import signal
from itertools import pairwise
from typing import Any

import pytest

from iptm_ros.codecs import ns_from_time, stamp_of
from iptm_ros.topics import Topic

S = 1_000_000_000
MODULES = {
    "controller": "iptm_controller.node",
    "v2x_bridge": "iptm_v2x_bridge.node",
    "plant": "iptm_plant_sim.node",
}
PARAMETERS: dict[str, dict[str, object]] = {
    "controller": {"horizon": "2x1+2x5"},
    "v2x_bridge": {},
    "plant": {"duration_s": 1e6, "command_timeout_wall_s": 120.0, "start_paused": True},
}


@pytest.mark.parametrize("killed", list(MODULES))
def test_a_killed_node_that_is_started_again_is_part_of_the_trip(
    launcher: Any, peer: Any, killed: str
) -> None:
    clocks: list[int] = []
    commands: list[int] = []
    peer.node.listen(Topic.CLOCK, lambda message: clocks.append(ns_from_time(message.clock)))
    peer.node.listen(Topic.PLANT_STATE, lambda _: None)
    peer.node.listen(Topic.COMMAND, lambda message: commands.append(stamp_of(message)))
    processes = {
        name: launcher.start_node(module, parameters=PARAMETERS[name])
        for name, module in MODULES.items()
    }
    peer.begin("plant", "v2x_bridge", "controller")
    peer.wait_until(lambda: clocks and commands[-1] >= 20 * S, what="the trip under way")
    processes[killed].popen.send_signal(signal.SIGKILL)
    processes[killed].popen.wait()
    reached_ns = commands[-1]
    again = launcher.start_node(MODULES[killed], parameters=PARAMETERS[killed])
    if killed == "plant":
        clocks.clear()
        peer.begin("plant", "v2x_bridge", "controller")
        peer.wait_until(lambda: 0 in clocks, what="the new trip")
        reached_ns = 0
        clocks.clear()
        commands.clear()
    wanted_ns = reached_ns + 20 * S
    peer.wait_until(
        lambda: min(commands[-1], clocks[-1]) >= wanted_ns,
        what=f"the trip going on with the new {killed}",
    )
    # No tick was skipped. Of a node that was started again, this one may miss the first messages.
    ticks = sorted(set(clocks if killed == "controller" else commands))
    assert [b - a for a, b in pairwise(ticks)] == [S] * (len(ticks) - 1)
    assert again.is_running
    for name, process in processes.items():
        assert name == killed or process.is_running
        assert "Traceback" not in process.stderr

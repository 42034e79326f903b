"""`iptm call` and `iptm param` beside running nodes: found by name, answered, refused, timed out."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from rclpy.node import Node
from std_srvs.srv import Trigger
from tests.waiting import PATIENCE_S

from iptm_ros import call, param

Ask = Callable[..., tuple[int, str, str]]
SHORT_S = 4.0
"""For what does not come: enough to discover a node of this machine."""


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Ask:
    """Run one of the tools in this process; return its exit code and what it printed."""

    def run(program: Any, *arguments: str, timeout_s: float = PATIENCE_S) -> tuple[int, str, str]:
        code = program.main([*arguments, "--timeout-s", str(timeout_s)])
        return (code, *capsys.readouterr())

    return run


@contextmanager
def spinning(peer: Any) -> Iterator[None]:
    """Let the node of the test answer meanwhile."""
    stop = threading.Event()

    def spin() -> None:
        while not stop.is_set():
            peer.executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_services_of_a_plant_in_a_namespace(launcher: Any, ask: Ask) -> None:
    parameters = {"cycle": "nycc", "start_paused": True}
    launcher.start_node("iptm_plant_sim.node", "-r", "__ns:=/car_1", parameters=parameters)
    assert ask(call, "plant")[:2] == (0, "pause\nreset\nresume\nsave_state\nstep\n")
    code, out, _ = ask(call, "car_1/plant", "pause")
    assert code == 0
    assert out.startswith("/car_1/plant: ")
    assert ask(call)[:2] == (0, "/car_1/plant\n")
    code, _, err = ask(call, "/car_1/plant", "paus")
    assert code == 2
    assert "did you mean 'pause'?" in err
    code, _, err = ask(param, "plant", "duraton_s=1")
    assert code == 2
    assert "'duration_s'" in err
    code, _, err = ask(call, "/plant", "pause", timeout_s=SHORT_S)
    assert code == 2
    assert "/car_1/plant" in err


def test_a_private_service_is_preferred_to_an_alias(peer: Any, ask: Ask) -> None:
    def served(text: str, *, success: bool) -> Callable[[Any, Any], Any]:
        def answer(_: Any, response: Trigger.Response) -> Trigger.Response:
            response.message, response.success = text, success
            return response

        return answer

    for name in ("~/pause", "aaa/pause", "zzz/pause"):
        peer.node.create_service(Trigger, name, served(name, success=True))
    peer.node.create_service(Trigger, "~/step", served("not paused", success=False))
    with spinning(peer):
        assert ask(call, "test_peer", "pause") == (0, "/test_peer: ~/pause\n", "")
        # The reason of the node, on stderr.
        assert ask(call, "/test_peer", "step") == (1, "", "/test_peer: not paused\n")


def test_a_node_that_does_not_answer_is_reported(peer: Any, ask: Ask) -> None:
    peer.node.create_service(Trigger, "~/pause", lambda _, response: response)
    code, _, err = ask(call, "/test_peer", "pause", timeout_s=SHORT_S)
    assert code == 2
    assert "/test_peer/pause does not answer within 4 s" in err
    code, _, err = ask(param, "/test_peer", timeout_s=SHORT_S)
    assert code == 2
    assert "/test_peer does not answer within 4 s" in err


def test_a_name_that_two_nodes_have_is_refused(peer: Any, ask: Ask) -> None:
    context = peer.node.context
    twins = [Node("twin", namespace=car, context=context) for car in ("car_1", "car_2")]
    code, _, err = ask(call, "twin")
    assert code == 2
    assert "allowed: /car_1/twin, /car_2/twin" in err
    assert ask(call, "car_2/twin", timeout_s=SHORT_S) == (0, "", "/car_2/twin offers no service\n")
    for node in twins:
        node.destroy_node()


@pytest.mark.parametrize("domain", ["233", "-1"])
def test_a_domain_out_of_range_is_refused(domain: str, ask: Ask) -> None:
    code, _, err = ask(call, "plant", f"--domain={domain}")
    assert code == 2
    assert "allowed: 0 to 232" in err


def test_parameters_are_read_as_users_write_numbers(launcher: Any, ask: Ask) -> None:
    launcher.start_node("iptm_controller.node", parameters={"horizon": "3x1"})
    code, out, _ = ask(param, "controller", "strategy=energy_aging", "aging_weight=2e8")
    assert code == 0
    assert out.splitlines()[0].startswith("strategy=energy_aging")
    # A whole number for a float, and what another process reads.
    assert ask(param, "controller", "speed_weight=50")[0] == 0
    lines = ask(param, "controller")[1].splitlines()
    shown = dict(line.split("    #")[0].split("=") for line in lines)
    assert shown["aging_weight"] == "200000000.0"
    assert shown["speed_weight"] == "50.0"
    # All or none: the second value is out of range.
    code, _, err = ask(param, "controller", "strategy=aging", "aging_weight=-7")
    assert code == 1
    assert "-7" in err
    assert ask(param, "controller", "strategy")[1].startswith("strategy=energy_aging")
    code, _, err = ask(param, "controller", "speed_weight=fast")
    assert code == 2
    assert "allowed: a number" in err


def test_every_type_of_parameter_is_read(peer: Any, ask: Ask) -> None:
    """A node of another project, with types that the suite does not use."""
    given = {"flag": True, "count": 3, "gain": 1.5, "name": "x", "gains": [1.0, 2.0]}
    for name, value in given.items():
        peer.node.declare_parameter(name, value)
    with spinning(peer):
        texts = ("flag=false", "count=4", "gain=-2e-3", "name=2e8", "gains=[3.0, 4e1]")
        assert ask(param, "test_peer", *texts)[0] == 0
        assert ask(param, "test_peer", "count=4.5")[0] == 2
        assert ask(param, "test_peer", "flag=no")[0] == 2
    found = {name: peer.node.get_parameter(name).value for name in given}
    found["gains"] = list(found["gains"])
    assert found == {"flag": False, "count": 4, "gain": -2e-3, "name": "2e8", "gains": [3.0, 40.0]}

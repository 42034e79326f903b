"""Faults in scenario files, and the processes that they bring."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from iptm.faults.fault import Fault, faults_from
from iptm.faults.kinds import FaultKind
from iptm.runner.composition import (
    INJECTOR,
    node_command,
    node_parameters,
)
from iptm.runner.scenario import prepare
from iptm.runner.scenario_files import load_scenario, scenario_text
from iptm_core.errors import ScenarioError
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT

OF_TOPICS = Fault(FaultKind.LEADER_HARD_STOP, 120.0)
OF_SOLVER = Fault(FaultKind.SOLVER_TIMEOUT, 60.0)
OF_PROCESS = Fault(FaultKind.PROCESS_KILLED, 60.0)


def parameters_with(*faults: Fault) -> dict[str, dict[str, object]]:
    return node_parameters(replace(prepare(load_scenario()), faults=faults))


def test_a_scenario_file_lists_faults_and_is_written_back(tmp_path: Path) -> None:
    path = tmp_path / "trip.yaml"
    path.write_text("cycle: us06\nfaults:\n  - {kind: leader_hard_stop, start_s: 120, size: 4}\n")
    scenario = load_scenario(path)
    assert scenario.faults == (Fault(FaultKind.LEADER_HARD_STOP, 120.0, size=4.0),)
    again = tmp_path / "again.yaml"
    again.write_text(scenario_text(scenario))
    assert load_scenario(again).faults == scenario.faults


def test_an_unknown_fault_is_refused_with_file_and_place(tmp_path: Path) -> None:
    path = tmp_path / "trip.yaml"
    path.write_text("faults: [{kind: leader_hard_stopp}]\n")
    with pytest.raises(ScenarioError, match=r"trip\.yaml: fault 1: kind is 'leader_hard_stopp'"):
        load_scenario(path)


def test_faults_of_topics_bring_an_injector_between_bridge_and_controller() -> None:
    plain, faulty = parameters_with(), parameters_with(OF_TOPICS, OF_SOLVER)
    assert INJECTOR not in plain
    received = faults_from(json.loads(str(faulty[INJECTOR]["faults"])), "parameter")
    assert received == (OF_TOPICS,)
    assert faulty[PLANT] == plain[PLANT]
    for node, count in ((CONTROLLER, 4), (BRIDGE, 4), (PLANT, 0), (INJECTOR, 0)):
        remapped = [
            part for part in node_command(node, Path("p"), "/", [OF_TOPICS]) if ":=faults/" in part
        ]
        assert len(remapped) == count
        assert not any(":=faults/" in part for part in node_command(node, Path("p"), "/"))


def test_faults_of_the_solver_bring_another_controller_and_nothing_else() -> None:
    plain, faulty = parameters_with(), parameters_with(OF_SOLVER)
    assert INJECTOR not in faulty
    received = faults_from(json.loads(str(faulty[CONTROLLER].pop("faults"))), "parameter")
    assert received == (OF_SOLVER,)
    assert faulty == plain
    command = node_command(CONTROLLER, Path("p"), "/", [OF_SOLVER])
    assert "iptm.faults.node_controller" in command


def test_faults_of_processes_leave_the_nodes_alone() -> None:
    assert parameters_with(OF_PROCESS) == parameters_with()
    assert node_command(CONTROLLER, Path("p"), "/", [OF_PROCESS]) == node_command(
        CONTROLLER, Path("p"), "/"
    )

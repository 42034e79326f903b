"""Faults in trip files, and the processes that they bring."""

from __future__ import annotations

import json
from pathlib import Path

from iptm.faults.fault import Fault, faults_from
from iptm.faults.kinds import FaultKind
from iptm.runner.composition import (
    INJECTOR,
    node_command,
    node_parameters,
)
from iptm.trip_files import load_trip, trip_text
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT

OF_TOPICS = Fault(FaultKind.LEADER_HARD_STOP, 120.0)
OF_SOLVER = Fault(FaultKind.SOLVER_TIMEOUT, 60.0)
OF_PROCESS = Fault(FaultKind.PROCESS_KILLED, 60.0)


def parameters_with(*faults: Fault) -> dict[str, dict[str, object]]:
    return node_parameters(load_trip().changed(faults=faults))


def test_a_scenario_file_lists_faults_and_is_written_back(tmp_path: Path) -> None:
    path = tmp_path / "trip.yaml"
    path.write_text("conditions:\n  faults:\n  - {kind: leader_hard_stop, start_s: 120, size: 4}\n")
    trip = load_trip(path)
    assert trip.conditions.faults == (Fault(FaultKind.LEADER_HARD_STOP, 120.0, size=4.0),)
    again = tmp_path / "again.yaml"
    again.write_text(trip_text(trip))
    assert load_trip(again).conditions.faults == trip.conditions.faults


def test_faults_of_topics_bring_an_injector_between_bridge_and_controller() -> None:
    plain, faulty = parameters_with(), parameters_with(OF_TOPICS, OF_SOLVER)
    assert INJECTOR not in plain
    received = faults_from(json.loads(str(faulty[INJECTOR]["faults"])), "parameter")
    assert received == (OF_TOPICS,)
    assert faulty[PLANT] == plain[PLANT]
    for node, count in ((CONTROLLER, 4), (BRIDGE, 4), (PLANT, 1), (INJECTOR, 0)):
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
    assert "iptm_faults.node_controller" in command


def test_faults_of_processes_leave_the_nodes_alone() -> None:
    assert parameters_with(OF_PROCESS) == parameters_with()
    assert node_command(CONTROLLER, Path("p"), "/", [OF_PROCESS]) == node_command(
        CONTROLLER, Path("p"), "/"
    )

"""Faults of processes: real processes of the test, killed, frozen, doubled and started again by trip time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.waiting import wait_until

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.runner.process_faults import ProcessFaults
from iptm.runner.supervisor import Supervisor

NS = 10**9
SLEEPER = [sys.executable, "-c", "import time; time.sleep(600)"]


@pytest.fixture
def supervisor(tmp_path: Path) -> Iterator[Supervisor]:
    owner = Supervisor({}, lambda name: tmp_path / f"{name}.log")
    owner.start("controller", SLEEPER)
    yield owner
    owner.stop()


def faults_of(supervisor: Supervisor, *faults: Fault) -> ProcessFaults:
    acting = ProcessFaults(supervisor, faults)
    acting.note({"controller": SLEEPER})
    return acting


def state_of(supervisor: Supervisor, name: str) -> str:
    status = Path(f"/proc/{supervisor.pid(name)}/status").read_text()
    return next(line.split()[1] for line in status.splitlines() if line.startswith("State:"))


def test_nothing_happens_before_its_time(supervisor: Supervisor) -> None:
    acting = faults_of(supervisor, Fault(FaultKind.PROCESS_KILLED, start_s=10.0))
    for time_ns in (None, 0, 9 * NS):
        acting.act(time_ns)
    assert supervisor.is_running("controller")
    acting.act(10 * NS)
    wait_until(lambda: not supervisor.is_running("controller"))
    assert acting.is_excused("controller")
    assert supervisor.endings()[0].code == -9
    assert [record.began_ns for record in acting.records] == [10 * NS]


def test_a_process_is_killed_and_started_again_once(supervisor: Supervisor) -> None:
    acting = faults_of(supervisor, Fault(FaultKind.PROCESS_RESTARTED, 1.0, size=0.05))
    acting.act(NS)
    wait_until(lambda: acting.act(2 * NS) or acting.current("controller") != "controller")
    again = acting.current("controller")
    assert supervisor.is_running(again)
    assert not acting.is_excused(again)
    assert acting.records[0].ended_ns == 2 * NS
    acting.act(NS)
    assert supervisor.names == ("controller", again)


def test_a_frozen_process_is_woken_up(supervisor: Supervisor) -> None:
    acting = faults_of(supervisor, Fault(FaultKind.PROCESS_FROZEN, 1.0, size=0.2))
    acting.act(NS)
    wait_until(lambda: state_of(supervisor, "controller") == "T")
    wait_until(lambda: acting.act(NS) or state_of(supervisor, "controller") == "S")
    assert not acting.is_excused("controller")


def test_a_double_comes_and_goes(supervisor: Supervisor) -> None:
    acting = faults_of(supervisor, Fault(FaultKind.PROCESS_DOUBLED, 1.0, size=0.2))
    acting.act(NS)
    first, copy = supervisor.names
    assert supervisor.is_running(copy)
    wait_until(lambda: acting.act(NS) or not supervisor.is_running(copy))
    assert supervisor.is_running(first)
    assert acting.is_excused(copy)


def test_a_double_lives_on_until_it_has_taken_part(supervisor: Supervisor) -> None:
    acting = faults_of(supervisor, Fault(FaultKind.PROCESS_DOUBLED, 1.0, size=0.0))
    for _ in range(3):
        acting.act(NS, is_doubled=lambda _: False)
    (record,) = acting.records
    assert record.ended_ns is None
    wait_until(lambda: acting.act(2 * NS, is_doubled="controller".__eq__) or record.ended_ns)


def test_a_full_disk_lets_no_file_grow(tmp_path: Path) -> None:
    code = (
        "import sys, time\n"
        "f = open(sys.argv[1], 'wb', buffering=0)\n"
        "f.write(b'x' * 100000)\n"
        "print('ready', flush=True)\n"
        "try:\n"
        "    while True:\n"
        "        f.write(b'x' * 100); time.sleep(0.01)\n"
        "except OSError as error:\n"
        "    print(error.strerror, flush=True)\n"
    )
    owner = Supervisor({}, lambda name: tmp_path / f"{name}.log")
    owner.start("recorder", [sys.executable, "-c", code, str(tmp_path / "bag")])
    try:
        wait_until(lambda: "ready" in owner.log_text("recorder"))
        ProcessFaults(owner, [Fault(FaultKind.DISK_FULL)]).act(0)
        wait_until(lambda: not owner.is_running("recorder"))
        assert "File too large" in owner.log_text("recorder")
    finally:
        owner.stop()

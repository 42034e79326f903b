"""Processes are started, missed and ended, however unwilling they are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.waiting import wait_until

from iptm.runner import supervisor as module
from iptm.runner.supervisor import LAST_LINES, Supervisor

OBEDIENT = "import time; print('ready', flush=True); time.sleep(600)"
CALM = """
import time
try:
    print('ready', flush=True)
    time.sleep(600)
except KeyboardInterrupt:
    pass
"""
DEAF = (
    "import signal, time; signal.signal({0}, signal.SIG_IGN); print('ready', flush=True);"
    "time.sleep(600)"
)
STUBBORN = (
    "import signal, time; [signal.signal(s, signal.SIG_IGN) for s in (signal.SIGINT,"
    " signal.SIGTERM)]; print('ready', flush=True); time.sleep(600)"
)


@pytest.fixture
def processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Supervisor]:
    for patience in ("INTERRUPT_PATIENCE_S", "TERMINATE_PATIENCE_S"):
        monkeypatch.setattr(module, patience, 0.3)
    supervisor = Supervisor(os.environ, lambda name: tmp_path / f"{name}.log")
    yield supervisor
    supervisor.stop()


def start(processes: Supervisor, name: str, program: str) -> None:
    processes.start(name, [sys.executable, "-c", program])


def codes(processes: Supervisor) -> dict[str, int]:
    return {ending.name: ending.code for ending in processes.endings()}


def test_an_end_is_noticed_with_code_and_last_words(processes: Supervisor) -> None:
    lines = 3 * LAST_LINES
    start(processes, "chatty", f"[print('line', k) for k in range({lines})]; raise SystemExit(7)")
    start(processes, "calm", OBEDIENT)
    wait_until(lambda: not processes.is_running("chatty"), what="the end")
    (ending,) = processes.endings()
    assert (ending.name, ending.code, ending.how) == ("chatty", 7, "ended with exit code 7")
    assert ending.last_lines == tuple(f"line {k}" for k in range(lines - LAST_LINES, lines))
    assert processes.is_running("calm")
    assert processes.names == ("chatty", "calm")


def test_a_killed_process_is_reported_as_killed(processes: Supervisor) -> None:
    start(processes, "victim", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    wait_until(lambda: not processes.is_running("victim"), what="the end")
    assert processes.endings()[0].how == "was killed by signal 9 (SIGKILL)"


@pytest.mark.parametrize(
    ("program", "number"),
    [
        (OBEDIENT, None),
        (DEAF.format("signal.SIGINT"), signal.SIGTERM),
        (STUBBORN, signal.SIGKILL),
    ],
)
def test_ends_with_as_much_force_as_it_takes(
    processes: Supervisor, program: str, number: signal.Signals | None
) -> None:
    start(processes, "process", program)
    wait_until(lambda: "ready" in processes.log_text("process"), what="the process")
    processes.stop()
    assert not processes.is_running("process")
    if number is not None:
        assert codes(processes) == {"process": -number}


def test_a_frozen_process_can_end(processes: Supervisor, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that a fault froze in the last second of a trip: it counts as ended well."""
    start(processes, "process", CALM)
    wait_until(lambda: "ready" in processes.log_text("process"), what="the process")
    processes.send("process", signal.SIGSTOP)
    # The time that Python takes to end is not tested.
    monkeypatch.setattr(module, "INTERRUPT_PATIENCE_S", 60.0)
    processes.stop()
    assert codes(processes) == {"process": 0}


def test_only_those_asked_for_are_ended(processes: Supervisor) -> None:
    for name in ("one", "two"):
        start(processes, name, OBEDIENT)
    processes.stop(["one"])
    assert [processes.is_running(name) for name in ("one", "two")] == [False, True]


def test_processes_hear_nothing_of_a_terminal(processes: Supervisor) -> None:
    """Ctrl-C goes to the whole group of the terminal; the processes must not be in it."""
    start(processes, "process", "import os; print('group', os.getpgid(0), flush=True)")
    wait_until(lambda: not processes.is_running("process"), what="the end")
    assert processes.log_text("process").split() != ["group", str(os.getpgid(0))]


RUNNER = """
import os, signal, sys, threading, time
from pathlib import Path
from iptm.runner.fork import PYTHON
from iptm.runner.supervisor import Supervisor

signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in the background of a shell
folder = Path(sys.argv[1])
sys.path.insert(0, str(folder))
import program
program.LOADED_BY = os.getpid()
held = (folder / "held").open("w")
if sys.argv[2] == "two threads":
    threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "GIVEN": "yes"}
processes = Supervisor(environment, lambda name: folder / f"{name}.log", forks=True)
processes.start("child", [*PYTHON, "program", "--one"])
while processes.is_running("child"):
    time.sleep(0.01)
print(processes.endings()[0].code, flush=True)
"""
PROGRAM = """
import os, sys, time
LOADED_BY = os.getpid()
def main():
    is_copy = LOADED_BY != os.getpid()
    files = [os.readlink(each.path) for each in os.scandir("/proc/self/fd") if int(each.name) > 2
             and os.path.exists(each.path)]
    try:
        print(os.getpid(), is_copy, sys.argv[1:], os.environ["GIVEN"], os.getpgid(0) == os.getpid(),
              any(file.endswith("held") for file in files), os.isatty(0), flush=True)
        time.sleep(600)
    except KeyboardInterrupt:
        return 5
"""


@pytest.mark.skipif(sys.platform != "linux", reason="services of Linux")
@pytest.mark.parametrize("threads", ["one thread", "two threads"])
@pytest.mark.parametrize("end", ["child", "runner"])
def test_a_program_of_the_suite_is_forked_where_that_is_safe_and_runs_as_if_started(
    tmp_path: Path, threads: str, end: str
) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    log = tmp_path / "child.log"
    command = [sys.executable, "-c", RUNNER, str(tmp_path), threads]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as runner:
        try:
            wait_until(lambda: log.exists() and log.read_text().endswith("\n"), what="the child")
            pid, *heard = log.read_text().split(maxsplit=1)
            assert heard == [f"{threads == 'one thread'} ['--one'] yes True False False\n"]
            if end == "child":
                os.kill(int(pid), signal.SIGINT)
                assert runner.communicate(timeout=120.0)[0] == "5\n"
        finally:
            runner.kill()
    wait_until(lambda: not is_alive(int(pid)), what="the end of the child")


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"

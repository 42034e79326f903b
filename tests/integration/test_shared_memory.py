"""Shared memory: nodes that end on a signal leave none; what killed ones leave is removed."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from iptm_ros.discovery import reserve_domain
from iptm_ros.shared_memory import FOLDER, remove_dead_shared_memory

COPY = """
import os, sys, time
from pathlib import Path
from iptm.runner.fork import Fork

fork = Fork("node", sys.argv[2:], Path(sys.argv[1]), dict(os.environ))
print(fork.pid, flush=True)
while fork.poll() is None:
    time.sleep(0.01)
sys.exit(fork.poll())
"""
NODES = {
    "plant": "iptm_plant_sim.node",
    "v2x_bridge": "iptm_v2x_bridge.node",
    "controller": "iptm_controller.node",
    "recorder": "iptm_ros.recording.recorder_cli",
}


FIRST_PORT = 7400
"""Of domain 0 (DDSI-RTPS 2.5, section 9.6.2)."""


def files_of(pid: int) -> set[Path]:
    """Return the files in shared memory on which a process holds locks, and those that belong to them.

    Ports below the first one of domain 0 are left out: all domains of a machine share them.
    """
    names = set()
    opened = []
    with suppress(FileNotFoundError):  # a process that has ended meanwhile
        for each in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(FileNotFoundError):  # closed meanwhile
                opened.append(each.readlink())
    for path in opened:
        if path.parent == FOLDER and path.name.endswith("_el"):
            name = path.name.removesuffix("_el")
            port = name.removeprefix("fastrtps_port")
            if not port.isdigit() or int(port) >= FIRST_PORT:
                names.add(name)
    return {FOLDER / each for name in names for each in (name, f"{name}_el", f"sem.{name}_mutex")}


def is_alive(pid: int) -> bool:
    """Return whether a process is there and neither dead nor a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def wait_for_the_end_of(files: set[Path], wait_until: Callable[..., None]) -> None:
    """Wait until files are gone: a start elsewhere that looks for dead ones locks each for a moment."""
    wait_until(lambda: not left(files), what=f"the end of {sorted(files)}")


def left(files: set[Path]) -> list[Path]:
    return sorted(path for path in files if path.exists())


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_copy_of_the_runner_that_ends_on_a_signal_leaves_no_shared_memory(
    launcher: Any,
    wait_until: Callable[..., None],
    tmp_path: Path,
    node: str,
    number: signal.Signals,
) -> None:
    given = [str(tmp_path / "bag")] if node == "recorder" else []
    log = tmp_path / "node.log"
    runner = launcher.start("copy", sys.executable, "-c", COPY, log, NODES[node], *given)
    wait_until(runner.stdout_path.read_text, what="the copy")
    pid = int(runner.stdout)
    wait_until(lambda: len(files_of(pid)) > 3, what="its files")
    files = files_of(pid)
    assert left(files)
    os.kill(pid, number)
    assert runner.wait() == 0, log.read_text()
    wait_for_the_end_of(files, wait_until)


def test_shared_memory_of_killed_processes_is_removed_at_the_next_start(
    launcher: Any, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    trip = ("--cycle", "comprehensive", "--horizon", "3x1", "--no-picture", "--processes")
    runner = launcher.start_module("iptm.commands.run", *trip, "--output", tmp_path / "bag")

    def processes() -> list[int]:
        children = Path(f"/proc/{runner.popen.pid}/task/{runner.popen.pid}/children").read_text()
        return [*map(int, children.split()), runner.popen.pid]

    def files() -> set[Path]:
        return {file for each in processes() for file in files_of(each)}

    wait_until(
        lambda: len(files()) >= 5 * 6, what="five participants with a segment and a port each"
    )
    own, started = files(), processes()
    for each in started:
        with suppress(ProcessLookupError):
            os.kill(each, signal.SIGKILL)
    runner.wait()
    wait_until(lambda: not any(map(is_alive, started)), what="their end")
    with reserve_domain():
        wait_for_the_end_of(own, wait_until)


@pytest.fixture
def segment() -> Iterator[Path]:
    """Return the path of a segment that does not exist."""
    path = FOLDER / f"fastrtps_{os.getpid():016x}"
    yield path
    for each in FOLDER.glob(f"{path.name}*"):
        each.unlink()


def holding(program: str) -> subprocess.Popen[bytes]:
    """Start a program that holds something until it is killed; return when it does."""
    process = subprocess.Popen(
        [sys.executable, "-c", f"{program}; print(flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"\n"
    return process


def test_shared_memory_with_an_owner_or_a_user_is_kept(
    segment: Path, wait_until: Callable[..., None]
) -> None:
    """Other tests and runs look for dead memory at the same time, so it is never without either."""
    lock = segment.with_name(f"{segment.name}_el")
    map_it = (
        f"import mmap; f = open({str(segment)!r}, 'r+b'); m = mmap.mmap(f.fileno(), 0); f.close()"
    )
    lock_it = f"import fcntl; f = open({str(lock)!r}, 'w'); fcntl.flock(f, fcntl.LOCK_EX)"
    with lock.open("w") as own:
        fcntl.flock(own, fcntl.LOCK_EX)
        segment.write_bytes(bytes(4096))
        user = holding(map_it)
    with user:
        assert segment.name not in remove_dead_shared_memory()
        owner = holding(lock_it)
        user.kill()
    with owner:
        assert segment.name not in remove_dead_shared_memory()
        assert segment.exists()
        owner.kill()

    def is_removed() -> bool:
        remove_dead_shared_memory()
        return not left({segment, lock})

    wait_until(is_removed, what="the removal")

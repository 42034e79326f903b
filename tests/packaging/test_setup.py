"""scripts/setup: made once, repaired when interrupted, one at a time.

A stand-in for Python records what it is asked to do, so that nothing is installed here.
"""

import subprocess
from pathlib import Path
from typing import Any

from tests.packaging.packages import FOLDERS, ROOT


def test_second_call_does_nothing(clone: Any) -> None:
    assert clone.setup("--check")[0] == 1
    assert clone.setup()[0] == 0
    assert "venv" in clone.calls()
    assert clone.setup() == (0, "")
    assert clone.setup("--check") == (0, "")
    assert clone.calls() == []


def test_packages_are_checked_against_hashes(clone: Any) -> None:
    clone.setup("--dev")
    installs = [call for call in clone.calls() if call.startswith("pip")]
    assert len(installs) == 2
    assert all("--require-hashes" in call for call in installs)
    assert "requirements/build.txt" in installs[0]
    assert "requirements/run.txt" in installs[1]
    assert "requirements/dev.txt" in installs[1]


def test_tools_are_added_to_what_is_there(clone: Any) -> None:
    clone.setup()
    clone.calls()
    assert clone.setup("--dev")[0] == 0
    assert "venv" not in clone.calls()
    assert clone.setup() == (0, "")
    assert clone.setup("--dev") == (0, "")


def test_a_compiler_is_fetched_where_there_is_none(clone: Any) -> None:
    (clone.bin / "cc").unlink()
    assert clone.setup()[0] == 0
    installs = [call for call in clone.calls() if call.startswith("pip")]
    assert "--require-hashes" in installs[-1]
    assert "requirements/compiler.txt" in installs[-1]
    assert clone.setup("--dev")[0] == 0
    assert clone.setup("--dev") == (0, "")
    # A new lock means a new compiler.
    with (clone.folder / "requirements" / "compiler.txt").open("a", encoding="utf-8") as lock:
        lock.write("# changed\n")
    assert clone.setup("--check")[0] == 1


def test_no_compiler_is_fetched_where_there_is_one_or_none_is_wanted(clone: Any) -> None:
    clone.setup()
    (clone.bin / "cc").unlink()
    assert clone.setup() == (0, "")
    clone.setup("--force", IPTM_COMPILER="none")
    clone.add_program("my_cc", "#!/bin/sh\n")
    clone.setup("--force", CC="my_cc -march=native")
    assert not any("compiler.txt" in call for call in clone.calls())
    code, errors = clone.setup("--force", IPTM_COMPILER="yes")
    assert code == 1
    assert "IPTM_COMPILER is 'yes'; allowed: none" in errors


def test_a_compiler_that_cannot_be_fetched_is_reported(clone: Any) -> None:
    (clone.bin / "cc").unlink()
    code, errors = clone.setup(FAKE_LACKING="compiler.txt")
    assert code == 0
    assert "trips need one" in errors
    assert clone.setup() == (0, "")


def test_the_named_python_counts_for_an_environment_that_is_there(clone: Any) -> None:
    assert clone.setup()[0] == 0
    clone.calls()
    assert clone.setup(IPTM_PYTHON="python3") == (0, "")
    code, errors = clone.setup(IPTM_PYTHON="python3.99")
    assert code == 1
    assert "python3.99" in errors
    assert clone.calls() == []
    clone.add_program("python3.12", clone.fake_python.replace("3.11.99", "3.12.1"))
    code, errors = clone.setup(IPTM_PYTHON="python3.12")
    assert code == 0
    assert "Python 3.12.1" in errors
    assert "venv" in clone.calls()
    assert clone.setup() == (0, ""), "the environment stays where no Python is named"


def test_ctrl_c_ends_the_set_up_with_one_line(clone: Any) -> None:
    # A shell that reaps its child before handling the signal carries on, so the child outlives the signal.
    interrupted = clone.fake_python.replace("mkdir -p", "kill -INT $PPID; sleep 0.3; mkdir -p")
    clone.add_program("python3", interrupted)
    code, errors = clone.setup()
    assert code == 130
    assert errors.splitlines()[-1] == "iptm: interrupted; the next call starts afresh."
    clone.add_program("python3", clone.fake_python)
    assert clone.setup()[0] == 0


def test_interrupted_set_up_starts_afresh(clone: Any) -> None:
    code, errors = clone.setup(FAKE_PIP_FAILS="No space left on device")
    assert code == 1
    assert "the disk is full" in errors
    leftover = clone.folder / ".venv" / "half_installed"
    leftover.touch()
    assert clone.setup("--check")[0] == 1
    assert clone.setup()[0] == 0
    assert not leftover.exists()


def test_interrupted_tools_start_afresh(clone: Any) -> None:
    clone.setup()
    assert clone.setup("--dev", FAKE_PIP_FAILS="killed")[0] == 1
    clone.calls()
    assert clone.setup()[0] == 0
    assert "venv" in clone.calls(), "an environment in an unknown state was taken for complete"


def test_changed_lock_starts_afresh(clone: Any) -> None:
    clone.setup()
    clone.calls()
    with (clone.folder / "requirements" / "run.txt").open("a", encoding="utf-8") as lock:
        lock.write("\n")
    assert clone.setup("--check")[0] == 1
    assert clone.setup()[0] == 0
    assert "venv" in clone.calls()


def test_moved_folder_starts_afresh(clone: Any, tmp_path: Path) -> None:
    clone.setup()
    moved = tmp_path / "moved"
    clone.folder.rename(moved)
    check = subprocess.run(
        [moved / "scripts" / "setup", "--check"], check=False, capture_output=True
    )
    assert check.returncode == 1


def test_one_set_up_at_a_time(clone: Any) -> None:
    both = [clone.start(FAKE_PIP_SECONDS="0.5") for _ in range(2)]
    results = [process.communicate(timeout=300)[1] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert clone.calls().count("venv") == 1
    assert sum("waiting for it" in text for text in results) <= 1


def test_sourced_ros_is_used(clone: Any) -> None:
    assert clone.setup(ROS_DISTRO="jazzy", FAKE_ROS="yes")[0] == 0
    installs = " ".join(clone.calls())
    assert "run-no-ros.txt" in installs
    assert "run.txt" not in installs
    # In a shell without it, the environment is not the right one.
    assert clone.setup("--check")[0] == 1
    entered = subprocess.run(
        ["bash", "-c", "source scripts/env.sh"],
        cwd=clone.folder,
        env=clone.environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert entered.returncode == 1
    assert "sourced ROS 2 Jazzy" in entered.stderr


def test_sourced_ros_that_does_not_import_is_reported(clone: Any) -> None:
    code, errors = clone.setup(ROS_DISTRO="jazzy")
    assert code == 0
    assert "cannot import rclpy" in errors


def test_entering_shuts_out_another_ros(clone: Any) -> None:
    clone.setup()
    other = {
        "ROS_DISTRO": "humble",
        "AMENT_PREFIX_PATH": "/opt/ros/humble",
        "LD_LIBRARY_PATH": "/opt/ros/humble/lib",
        "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    }
    entered = subprocess.run(
        ["bash", "-euc", "source scripts/env.sh; source scripts/env.sh; env -0"],
        cwd=clone.folder,
        env=clone.environment(**other),
        capture_output=True,
        text=True,
        check=True,
    )
    environment = dict(line.split("=", 1) for line in entered.stdout.split("\0") if line)
    venv = clone.folder / ".venv"
    assert environment["AMENT_PREFIX_PATH"] == str(venv)
    assert environment["PATH"].startswith(f"{venv}/bin:")
    packages = [str(clone.folder / path.relative_to(ROOT)) for path in FOLDERS.values()]
    # The root is there for the studies, which are no package.
    assert sorted(environment["PYTHONPATH"].split(":")) == sorted([str(clone.folder), *packages])
    assert "LD_LIBRARY_PATH" not in environment
    assert "ROS_DISTRO" not in environment
    assert environment["OMP_NUM_THREADS"] == environment["OPENBLAS_NUM_THREADS"] == "1"
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET", "the user's choice is kept"

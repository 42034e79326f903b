"""scripts/setup on a machine that lacks something: one or two lines that name it.

A stand-in for Python records what it is asked to do, so that nothing is installed here.
"""

import sys
from typing import Any

import pytest


def real_python(clone: Any, change: str) -> str:
    """The stand-in, but what it gets on standard input runs in this Python, with something changed first."""
    code = f"import sys, platform; {change}; sys.argv = sys.argv[1:]; exec(sys.stdin.read())"
    real = f"exec '{sys.executable}' -I -c '{code}' \"$@\""
    return str(clone.fake_python.replace("cat > /dev/null", real))


OLD = 'sys.version_info = (3, 9, 2); platform.python_version = lambda: "3.9.2"'
NO_VENV = 'sys.modules["ensurepip"] = None'
ARM = '#!/bin/sh\n[ "$1" = -m ] && echo aarch64 || echo Linux\n'
# The program that is another one, its text or the change of the real Python, and what is named.
LACKS: dict[str, tuple[str, str, list[str]]] = {
    "Python": ("python3", "", ["no python3", "apt install python3-venv"]),
    "a new Python": ("python3", OLD, ["python3 is 3.9.2", "3.10 to 3.13", "IPTM_PYTHON="]),
    "venv": ("python3", NO_VENV, ["lacks the venv module", "apt install python3-venv"]),
    "a known processor": ("uname", ARM, ["Linux on aarch64", "Install ROS 2 Jazzy, source it"]),
    "glibc": ("getconf", "#!/bin/sh\nexit 1\n", ["glibc 2.28"]),
}


@pytest.mark.parametrize("lacking", LACKS)
def test_what_a_machine_lacks_is_named_in_two_lines(clone: Any, lacking: str) -> None:
    program, text, named = LACKS[lacking]
    if not text:
        (clone.bin / program).unlink()
    else:
        is_change = not text.startswith("#!")
        clone.add_program(program, real_python(clone, text) if is_change else text)
    code, errors = clone.setup()
    assert code == 1
    assert len(errors.splitlines()) <= 2
    assert [each for each in named if each not in errors] == []
    assert not (clone.folder / ".venv").exists()
    # Another Python on the path will do, and on another processor a sourced ROS.
    if lacking == "a new Python":
        clone.add_program("python3.12", clone.fake_python)
        assert clone.setup()[0] == 0
    if lacking == "a known processor":
        assert clone.setup(ROS_DISTRO="jazzy", FAKE_ROS="yes")[0] == 0


def test_a_named_python_that_is_not_there(clone: Any) -> None:
    code, errors = clone.setup(IPTM_PYTHON="python3.99")
    assert code == 1
    assert "no python3.99" in errors


def test_this_python_will_do(clone: Any) -> None:
    """The real check on the real interpreter: what runs these tests is suitable."""
    clone.add_program("python3", real_python(clone, "pass"))
    assert clone.setup()[0] == 0


def test_no_network(clone: Any) -> None:
    code, errors = clone.setup(FAKE_PIP_FAILS="NewConnectionError: Name or service not known")
    assert code == 1
    assert "could not be reached" in errors
    assert "NewConnectionError" in errors, "the end of the log is shown"


def test_unknown_option(clone: Any) -> None:
    code, errors = clone.setup("--hurry")
    assert code == 1
    assert "'--hurry'" in errors
    assert "--force" in errors


def test_folder_that_cannot_be_written(clone: Any) -> None:
    (clone.folder / ".venv").write_text("in the way", encoding="utf-8")
    code, errors = clone.setup()
    assert code == 1
    (line,) = errors.splitlines()
    assert f"cannot write to {clone.folder}/.venv, which is not complete" in line


def test_environment_of_another_user(clone: Any) -> None:
    """A folder in the place of the lock stands for a lock that this user may not write."""
    assert clone.setup()[0] == 0
    (clone.folder / ".venv" / ".setup.lock").unlink()
    (clone.folder / ".venv" / ".setup.lock").mkdir()
    assert clone.setup() == (0, ""), "a complete environment needs no write access"
    code, errors = clone.setup("--dev")
    assert code == 1
    (line,) = errors.splitlines()
    assert "cannot write to" in line
    assert "scripts/setup --dev" in line
    (clone.folder / ".venv" / "bin" / "python").unlink()
    assert "a Python that this user cannot start" in clone.setup()[1]

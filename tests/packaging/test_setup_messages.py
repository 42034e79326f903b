"""scripts/setup on a machine that lacks something: one or two lines that name it.

A stand-in for Python records what it is asked to do, so that nothing is installed here.
"""

import sys
from typing import Any


def plain_words(clone: Any, *expected: str, **extra: str) -> None:
    code, errors = clone.setup(**extra)
    assert code == 1
    assert len(errors.splitlines()) <= 2
    for text in expected:
        assert text in errors
    assert not (clone.folder / ".venv").exists()


def test_no_python(clone: Any) -> None:
    (clone.bin / "python3").unlink()
    plain_words(clone, "no python3", "apt install python3-venv")


def real_python(clone: Any, change: str) -> str:
    """The stand-in, but what it gets on standard input runs in this Python, with something changed first."""
    code = f"import sys, platform; {change}; sys.argv = sys.argv[1:]; exec(sys.stdin.read())"
    real = f"exec '{sys.executable}' -I -c '{code}' \"$@\""
    return clone.fake_python.replace("cat > /dev/null", real)


def test_wrong_python(clone: Any) -> None:
    old = 'sys.version_info = (3, 9, 2); platform.python_version = lambda: "3.9.2"'
    clone.add_program("python3", real_python(clone, old))
    plain_words(clone, "python3 is 3.9.2", "3.10 to 3.13", "IPTM_PYTHON=")


def test_other_python_on_the_path_will_do(clone: Any) -> None:
    old = 'sys.version_info = (3, 9, 2); platform.python_version = lambda: "3.9.2"'
    clone.add_program("python3", real_python(clone, old))
    clone.add_program("python3.12", clone.fake_python)
    assert clone.setup()[0] == 0


def test_python_without_venv(clone: Any) -> None:
    clone.add_program("python3", real_python(clone, 'sys.modules["ensurepip"] = None'))
    plain_words(clone, "lacks the venv module", "apt install python3-venv")


def test_this_python_will_do(clone: Any) -> None:
    """The real check on the real interpreter: what runs these tests is suitable."""
    clone.add_program("python3", real_python(clone, "pass"))
    assert clone.setup()[0] == 0


def test_named_python_that_is_not_there(clone: Any) -> None:
    plain_words(clone, "no python3.99", IPTM_PYTHON="python3.99")


def test_other_processor(clone: Any) -> None:
    clone.add_program("uname", '#!/bin/sh\n[ "$1" = -m ] && echo aarch64 || echo Linux\n')
    plain_words(clone, "Linux on aarch64", "Install ROS 2 Jazzy, source it")
    assert clone.setup(ROS_DISTRO="jazzy", FAKE_ROS="yes")[0] == 0


def test_other_c_library(clone: Any) -> None:
    clone.add_program("getconf", "#!/bin/sh\nexit 1\n")
    plain_words(clone, "glibc 2.28")


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

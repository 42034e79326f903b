"""How programs start and end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import pytest

from iptm_core import program


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for the module `made_up`, which the executable `plant` is to run."""
    entry = EntryPoint("plant", "made_up:main", program.PROGRAMS)

    def entry_points(**wanted: Any) -> EntryPoints:
        return EntryPoints([entry]).select(**wanted)

    monkeypatch.setattr("importlib.metadata.entry_points", entry_points)
    monkeypatch.setattr(sys, "argv", ["/install/iptm_plant_sim/lib/iptm_plant_sim/plant", "-x"])
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "made_up", raising=False)
    return tmp_path


def test_runs_the_program_of_its_name(installed: Path) -> None:
    (installed / "made_up.py").write_text("def main():\n    return 7\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 7


def test_a_missing_library_is_one_line(installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (installed / "made_up.py").write_text("import not_installed_here\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("plant: No module named 'not_installed_here'")
    assert "requirements/run-no-ros.txt" in line


SLOW_IMPORT = """
print("importing", flush=True)
import time
time.sleep(600)
def main(): ...
"""
SLOW_MAIN = """
import sys, time
def main():
    print("running", sys.argv[1:], flush=True)
    time.sleep(600)
"""
MANY_LINES = """
def main():
    for number in range(1_000_000):
        print(number)
    return 0
"""


def start(folder: Path, text: str, *prefix: str) -> subprocess.Popen[str]:
    """Start a module as the commands in scripts/ do."""
    (folder / "made_up.py").write_text(text, encoding="utf-8")
    paths = f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    return subprocess.Popen(
        [*prefix, sys.executable, "-m", "iptm_core", "made_up", "-x", "1"],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("text", "first", "code"),
    [(SLOW_IMPORT, "importing", -signal.SIGINT), (SLOW_MAIN, "running ['-x', '1']", 130)],
)
def test_ctrl_c_leaves_no_traceback(tmp_path: Path, text: str, first: str, code: int) -> None:
    process = start(tmp_path, text)
    assert process.stdout.readline() == f"{first}\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert (process.returncode, errors) == (code, "")


def test_ctrl_c_before_the_first_statement_is_held_back_and_obeyed(tmp_path: Path) -> None:
    process = start(tmp_path, SLOW_IMPORT, "env", "--block-signal=INT")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == -signal.SIGINT
    assert errors == ""


def test_a_reader_that_has_enough_ends_the_program(tmp_path: Path) -> None:
    with start(tmp_path, MANY_LINES) as process:
        assert process.stdout.readline() == "0\n"
        process.stdout.close()
        assert process.wait(timeout=300) == 128 + signal.SIGPIPE
        assert process.stderr.read() == ""


@pytest.mark.parametrize("redirection", ["", ">&-", ">/dev/full", "2>&- >&-"])
def test_output_that_is_closed_full_or_not_in_utf_8(tmp_path: Path, redirection: str) -> None:
    (tmp_path / "made_up.py").write_text(
        "import sys\n"
        "def main():\n"
        "    print('\u222b dt', flush=True)\n"
        "    sys.stdout.isatty()\n"
        "    open('done', 'w').write(str(__doc__))\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{os.environ['PYTHONPATH']}"}
    ended = subprocess.run(
        ["sh", "-c", f"exec {sys.executable} -OO -m iptm_core made_up {redirection}"],
        cwd=tmp_path,
        env={**environment, "PYTHONIOENCODING": "latin-1", "PYTHONOPTIMIZE": "2"},
        capture_output=True,
        check=False,
    )
    if "full" in redirection:
        assert ended.returncode == program.EXIT_USER_ERROR
        assert ended.stderr.startswith(b"made_up: output cannot be written: [Errno 28]")
        assert ended.stderr.count(b"\n") == 1
        return
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert ended.stdout == (b"? dt\n" if not redirection else b"")
    assert (tmp_path / "done").exists()

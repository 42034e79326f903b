"""The command line: output, exit codes, and interruption."""

import csv
import io
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from iptm.studies import cli
from iptm.studies.campaign import plan_campaign
from iptm.studies.cli import main
from iptm.studies.store import ResultStore
from iptm_core.program import EXIT_USER_ERROR

WriteFile = Callable[..., Path]
PATIENCE_S = 300.0
SHORTER_STUDY = """
title: Another
defaults: {cycle: us06, duration_s: 6, horizon: 3x1+5x5}
cases: [{name: aging}]
"""


@pytest.fixture
def folder(tmp_path: Path) -> str:
    return str(tmp_path / "kept")


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^strategies +6 cases  Six strategies", text, re.MULTILINE)
    assert re.search(r"^sampling_time +25 cases", text, re.MULTILINE)


@pytest.mark.usefixtures("at_once")
def test_run_status_tables_prune(
    study_file: WriteFile, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(study_file())
    assert main(["status", path, "--store", folder, "--verbose"]) == 0
    assert "mini                   0 of   2 cases" in capsys.readouterr().out

    assert main(["run", path, "--store", folder]) == cli.EXIT_FAILED_RUNS
    output = capsys.readouterr().err
    assert "1 runs computed, 0 found" in output
    assert "1 failed, in " in output
    assert "mini/reference failed: it went nowhere" in output

    assert main(["status", path, "--store", folder]) == 0
    output = capsys.readouterr().out
    assert "1 of   2 cases" in output
    assert "reference: it went nowhere" in output

    assert main(["tables", path, "--store", folder]) == 0
    (table,) = capsys.readouterr().out.split()
    good, bad = csv.DictReader(io.StringIO(Path(table).read_text(encoding="utf-8")))
    assert (good["study"], good["case"], good["horizon"]) == ("mini", "aging", "3x1+5x5")
    assert float(good["cell_1_degradation [10⁻⁵]"]) == pytest.approx(1e5 * 5e-9)
    assert float(good["fallbacks [ticks]"]) == 2.0
    assert good["mean_cop [1]"] == ""
    assert "lambda_Q=1e+09" in good["strategy"]
    assert bad["cell_1_degradation [10⁻⁵]"] == ""
    assert bad["reason"] == "it went nowhere"

    other = str(study_file(SHORTER_STUDY))
    assert main(["prune", other, "--store", folder]) == 0
    assert "2 files deleted" in capsys.readouterr().err
    assert ResultStore(Path(folder)).keys() == ()


def test_dry_run_shows_what_would_be_computed(
    study_file: WriteFile, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(study_file())
    assert main(["run", path, "--store", folder, "--dry-run", "--workers", "4"]) == 0
    text = capsys.readouterr().out
    assert "mini/aging" in text
    assert "2 runs to compute" in text
    assert "with 4 workers" in text
    assert not Path(folder).exists()
    assert main(["--small", "--store", folder, "--dry-run"]) == 0  # the default command
    text = capsys.readouterr().out
    assert "once the weights are known" in text
    assert "  comprehensive" not in text
    assert "us06 600 s" in text


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run", "strategys"], "did you mean 'strategies'"),
        (["run", "no.yaml"], "no such file"),
        (["run", "strategies", "--workers", "0"], "workers is 0"),
    ],
)
def test_refusals(
    arguments: list[str], complaint: str, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--store", folder]) == EXIT_USER_ERROR
    output = capsys.readouterr().err
    assert complaint in output
    assert "Traceback" not in output


def test_usage_errors(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["paint"])
    assert caught.value.code == EXIT_USER_ERROR
    assert "invalid choice" in capsys.readouterr().err


SECOND_CTRL_C_S = 20.0
"""Python drops an interrupt that arrives in a finaliser; a second one is sent after this time."""


def test_stopping_leaves_the_store_sound(study_file: WriteFile, tmp_path: Path) -> None:
    """Ctrl-C at a terminal reaches the command and its workers; the next call goes on."""
    text = """
title: Long
defaults: {cycle: us06, horizon: 3x1+5x5}
cases:
  - {name: short, run: {duration_s: 3}}
  - {name: long, run: {cycle: comprehensive, duration_s: 9000}}
  - {name: longer, run: {cycle: comprehensive, duration_s: 9000, strategy: reference}}
"""
    path, store = study_file(text), ResultStore(tmp_path / "kept")
    short = next(run for run in plan_campaign([str(path)]).take() if run.address == "mini/short")
    command = [sys.executable, "-m", "iptm.studies.cli", "run", str(path)]
    command += ["--store", str(store.folder), "--workers", "3"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        wait_for(lambda: len(store.keys()) == 1, process)
        os.killpg(process.pid, signal.SIGINT)
        try:
            _, output = process.communicate(timeout=SECOND_CTRL_C_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT)
            _, output = process.communicate(timeout=PATIENCE_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130
    assert "goes on from what is stored" in output
    assert "Traceback" not in output
    assert store.keys() == (short.key,)
    assert store.load(short.key).spec == short.spec
    assert {entry.suffix for entry in store.folder.iterdir()} == {".parquet"}
    wait_for(lambda: not group_lives(process.pid), None)


def wait_for(condition: Callable[[], bool], process: "subprocess.Popen[str] | None") -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert process is None or process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.1)


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True

"""Every command of the page runs as it is written there; trips are shorter."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.documented_commands import ROOT, documented_commands

import iptm

pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
validation = pytest.importorskip("fmpy.validation")
builder = pytest.importorskip(
    "pythonfmu.builder", reason="pythonfmu is not installed (requirements/fmi.txt)"
)
HERE = Path(__file__).parent
COMMANDS = [each for each, page in documented_commands().items() if page.endswith("fmi.md")]
FMU = [each for each in COMMANDS if each.startswith("scripts/iptm fmu")]
RUN = [each for each in COMMANDS if each.startswith("scripts/iptm run")]
SPEED = "python -m tests.extras.iptm_fmi.speed"
pytestmark = pytest.mark.slow


def test_no_command_is_left_out() -> None:
    others = {each for each in COMMANDS if "pip install" not in each} - {*FMU, *RUN}
    assert others == {SPEED}
    assert len(FMU) >= 3
    assert RUN


@pytest.mark.parametrize("command", FMU)
def test_fmus_are_written(command: str, tmp_path: Path) -> None:
    done = ran(command, tmp_path)
    assert done.returncode == 0, done.stderr
    written = list(tmp_path.glob("*.fmu"))
    assert len(written) == (2 if "--fmi both" in command else 1)
    for path in written:
        assert list(validation.validate_fmu(str(path))) == []


@pytest.mark.parametrize("command", RUN)
def test_a_foreign_car_drives_over_ros_twice_with_equal_bags(command: str, tmp_path: Path) -> None:
    made = builder.FmuBuilder.build_FMU(str(HERE / "foreign_car.py"), dest=str(tmp_path))
    shutil.move(made, tmp_path / "my_car.fmu")
    shutil.copy(HERE / "foreign_car.yaml", tmp_path / "my_car.yaml")
    frames = []
    for bag in ("first", "second"):
        short = f"{command} --duration-s 30 --against none --no-picture --output {bag}"
        done = ran(short, tmp_path)
        assert done.returncode == 0, done.stderr + done.stdout
        frames.append(iptm.load(tmp_path / bag).frame)
    differing = {name for name in frames[0] if not frames[0][name].equals(frames[1][name])}
    assert differing <= {"solve_time_s", "solve_wall_time_s"}
    assert frames[0].position_m.iloc[-1] > 10.0
    in_memory = iptm.simulate(
        "wltc_class3b", duration_s=30.0, plant=str(tmp_path / "my_car.fmu")
    ).frame
    assert in_memory.position_m.to_numpy() == pytest.approx(frames[0].position_m.to_numpy())


def test_speeds_are_printed() -> None:
    done = subprocess.run(
        [sys.executable, *shlex.split(SPEED)[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "plant step" in done.stdout


def ran(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a documented command in a folder."""
    program, *arguments = shlex.split(command)
    return subprocess.run(
        [str(ROOT / program), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )

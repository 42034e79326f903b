"""The workspace builds with colcon, and what is installed runs from there."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

pytestmark = pytest.mark.integration

ROOT = Path(__file__).resolve().parents[2]


def test_workspace_builds_and_executables_run() -> None:
    ready = subprocess.run([ROOT / "scripts" / "setup", "--dev", "--check"], check=False)
    if ready.returncode != 0:
        pytest.skip("needs the environment that scripts/test makes")
    build = subprocess.run(
        [ROOT / "scripts" / "colcon_build"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert build.returncode == 0, build.stdout + build.stderr
    for executable in (
        "iptm_plant_sim/plant",
        "iptm_v2x_bridge/bridge",
        "iptm_controller/controller",
    ):
        package, name = executable.split("/")
        assert f"runs: install/{package}/lib/{package}/{name}\n" in build.stdout
    # What was built is tested by the tests of its package; one small file stands for all.
    colcon_test = "colcon test --return-code-on-test-failure --packages-select iptm_faults"
    test = subprocess.run(
        [
            "bash",
            "-c",
            f"source scripts/env.sh; cd ros2_ws; {colcon_test} --pytest-args -k test_traffic",
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert test.returncode == 0, test.stdout + test.stderr
    results = ET.parse(ROOT / "ros2_ws" / "build" / "iptm_faults" / "pytest.xml").getroot()  # noqa: S314 (our own file)
    assert int(results.find("testsuite").get("tests", 0)) > 0

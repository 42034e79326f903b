"""The workspace builds with colcon, and what is installed runs from there."""

import subprocess
from xml.etree import ElementTree as ET

import pytest
from tests.packaging.packages import ROOT

pytestmark = pytest.mark.integration
TEST = (
    "source scripts/env.sh; cd ros2_ws; colcon test --return-code-on-test-failure "
    "--packages-select iptm_plant_sim --pytest-args -k test_motion"
)
"""What was built is tested by the tests of its package; one small file stands for all."""


def run(*command: str) -> str:
    """Run a command in the repository; return what it printed."""
    done = subprocess.run(
        command, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300,
        check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_workspace_builds_and_executables_run() -> None:
    ready = subprocess.run([ROOT / "scripts" / "setup", "--dev", "--check"], check=False)
    if ready.returncode != 0:
        pytest.skip("needs the environment that scripts/test makes")
    printed = run("scripts/dev", "build")
    for package, name in (
        ("iptm_plant_sim", "plant"),
        ("iptm_v2x_bridge", "bridge"),
        ("iptm_controller", "controller"),
    ):
        assert f"runs: install/{package}/lib/{package}/{name}\n" in printed
    run("bash", "-c", TEST)
    results = ET.parse(ROOT / "ros2_ws" / "build" / "iptm_plant_sim" / "pytest.xml").getroot()  # noqa: S314 (our own file)
    assert int(results.find("testsuite").get("tests", 0)) > 0

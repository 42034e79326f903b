"""`pip install .` gives the library: with what it declares, without ROS, in an environment of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from tests.packaging.packages import ROOT, manifest_of

TRY_IT = """
import importlib.util, sys
import iptm

assert iptm.__file__.startswith(sys.prefix), iptm.__file__
assert importlib.util.find_spec("rclpy") is None
run = iptm.simulate("us06", duration_s=20.0)
assert run.frame.shape[0] == 21
assert run.summary["duration [s]"] == 20.0
run.plot().savefig("run.png")
other = iptm.simulate("us06", duration_s=20.0, strategy="reference", horizon="3x1")
both = iptm.compare(run, other, bag=iptm.load(sys.argv[1]))
assert both.table.shape[1] == 5
both.plot().savefig("both.png")
sweep = iptm.sweep(cycle=["us06", "udds"], horizon="3x1", duration_s=5.0)
assert sweep.table.shape[0] == 2
print("done")
"""


def declared_distributions(requirements: list[str]) -> Iterator[metadata.Distribution]:
    """Yield the installed distributions that a list of requirements leads to."""
    waiting, seen = list(requirements), set()
    while waiting:
        requirement = Requirement(waiting.pop())
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        name = requirement.name.lower()
        if name in seen:
            continue
        seen.add(name)
        found = metadata.distribution(name)
        assert requirement.specifier.contains(found.version, prereleases=True), requirement
        yield found
        waiting += found.requires or []


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """An environment with the library and the distributions that it declares, linked and not downloaded."""
    listed = subprocess.run(
        ["git", "ls-files", "--", "pyproject.toml", "README.md", "ros2_ws/src"],
        cwd=ROOT, capture_output=True, text=True, check=True
    )  # fmt: skip
    source = tmp_path / "source"
    for name in filter(None, listed.stdout.splitlines()):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    environment = tmp_path / "environment"
    venv.create(environment, symlinks=True)
    (packages,) = environment.glob("lib/python3*/site-packages")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--target", str(packages)]
    subprocess.run([*command, *options, str(source)], check=True, env=clean(), cwd=tmp_path)
    (own,) = metadata.distributions(name="iptm", path=[str(packages)])
    for distribution in declared_distributions(own.requires or []):
        for top in {file.parts[0] for file in distribution.files or []} - {"..", "__pycache__"}:
            link = packages / top
            if not link.exists():
                link.symlink_to(Path(str(distribution.locate_file(top))))
    return environment


def clean() -> dict[str, str]:
    """Return the variables of a shell that has not entered the project."""
    ours = ("PYTHON", "ROS_", "AMENT_", "_ROS", "IPTM_ROOT", "PIP_")
    return {name: value for name, value in os.environ.items() if not name.startswith(ours)}


def test_the_library_works_without_ros(library: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [library / "bin" / "python", "-c", TRY_IT, ROOT / "bags" / "example_us06_120s"],
        cwd=tmp_path, env=clean(), capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_the_version_is_that_of_the_packages() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'\nversion = "{manifest_of("iptm").findtext("version")}"\n' in text

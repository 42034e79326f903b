"""`pip install .` gives the library: with what it declares, without ROS, in an environment of its own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from tests.packaging.packages import FOLDERS, ROOT, manifest_of

import iptm

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
    """So do the snippet of the README, which writes a picture, and the command `iptm`."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    code = TRY_IT.replace('print("done")', f'{snippet}\nprint("done")')
    done = subprocess.run(
        [library / "bin" / "python", "-c", code, ROOT / "bags" / "example_us06_120s"],
        cwd=tmp_path, env=clean(), capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("\ndone\n")
    (command,) = library.rglob("bin/iptm")
    for arguments, expected in ((["info", ROOT / "bags" / "example_us06_120s"], 0), (["call"], 2)):
        called = subprocess.run(
            [library / "bin" / "python", command, *arguments],
            cwd=tmp_path, env=clean(), capture_output=True, text=True, timeout=300, check=False
        )  # fmt: skip
        assert called.returncode == expected, called.stderr
    assert "needed: ROS 2" in called.stderr
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


LIBRARY_TESTS = (
    "tests/iptm/test_simulation.py",
    "tests/extras/iptm_drives/test_routes_user_csv.py",
    "tests/extras/iptm_drives/test_routes_recorded.py",
    "tests/iptm_core/test_metrics_run.py",
    "tests/iptm_controller/test_compilation.py",
)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["lowest", "newest"])
def test_what_is_declared_is_true_at_both_ends(tmp_path: Path, end: str) -> None:
    """The lowest and the newest versions that are declared run the library's tests; they are downloaded."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    listed = text.partition("\ndependencies = [")[2].partition("]")[0]
    declared = re.findall(r'"([^"]+)"', listed)
    lowest = [each.replace(">=", "==") for each in declared]
    environment = tmp_path / "environment"
    venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    wanted = lowest if end == "lowest" else declared
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run(
        [*install, "--only-binary", ":all:", *wanted, "pytest", "hypothesis", "packaging"],
        check=True,
        env=clean(),
    )
    paths = [str(folder) for folder in FOLDERS.values()]
    tests = [str(ROOT / name) for name in LIBRARY_TESTS]
    for command in (
        ["-c", TRY_IT.replace("assert iptm.__file__", "#"), ROOT / "bags" / "example_us06_120s"],
        [
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-c",
            str(ROOT / "pyproject.toml"),
            # Old versions warn of what new ones have renamed.
            "-W",
            "ignore::DeprecationWarning",
            *tests,
        ],
    ):
        done = subprocess.run(
            [python, *command],
            cwd=ROOT if "-m" in command else tmp_path,
            env={**clean(), "PYTHONPATH": os.pathsep.join(paths)},
            capture_output=True,
            text=True,
            timeout=1200,
            check=False,
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def test_the_version_is_that_of_the_packages() -> None:
    version = manifest_of("iptm").findtext("version")
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'\nversion = "{version}"\n' in text
    assert iptm.__version__ == version
    assert f"\n## [{version}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

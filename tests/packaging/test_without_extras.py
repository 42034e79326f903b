"""The core works with no extra installed, and every extra can be absent alone.

``scripts/test --core`` runs the quick tests of the core without extras; this is the part that is always run.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from tests.packaging.packages import EXTRAS, FOLDERS, PACKAGES, modules_of

COMMANDS_OF = """
import sys
from iptm.commands.tree import COMMANDS, all_commands
from iptm_core.extras import offered
parts = ("commands", "drives", "faults", "library", "plants", "strings", "v2x")
offers = {module.__name__.partition(".")[0] for part in parts for module in offered(part)}
print(*sorted(offers), *(all_commands().keys() - COMMANDS.keys()))
"""
OFFERING = [name for name in EXTRAS if list(FOLDERS[name].glob("*/extra_*.py"))]
"""Extras that the core looks for; the others use the core only."""
DRIVE = """
import importlib, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        assert not error.name.startswith("iptm"), (name, error)
import iptm
assert iptm.simulate("us06", duration_s=5.0, strategy="reference", horizon="3x1").frame.shape[0] == 6
assert not [name for name, module in sys.modules.items() if "src/extras/" in str(module)]
"""


def without(absent: list[str], code: str, *arguments: str) -> str:
    """Run code where some packages are not installed; return what it prints."""
    there = [str(FOLDERS[name]) for name in PACKAGES if name not in absent]
    paths = [
        path for path in os.environ["PYTHONPATH"].split(os.pathsep) if "ros2_ws/src" not in path
    ]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([*there, *paths])},
        capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_of_the_core_loads_and_a_trip_is_driven_without_extras() -> None:
    core = [name for name in PACKAGES if name not in EXTRAS]
    modules = sorted(module.name for name in core for module in modules_of(name))
    without(EXTRAS, DRIVE, *(name for name in modules if not name.endswith("__main__")))


@pytest.fixture(scope="module")
def whole() -> list[str]:
    """Extras that offer something, and their commands, where all are installed."""
    return without([], COMMANDS_OF).split()


@pytest.mark.parametrize("absent", OFFERING)
def test_an_absent_extra_takes_its_own_commands_with_it(absent: str, whole: list[str]) -> None:
    rest = without([absent], COMMANDS_OF).split()
    assert set(rest) < set(whole)
    assert {name for name in whole if name in EXTRAS} - set(rest) == {absent}

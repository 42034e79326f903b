"""Every option that a sentence, a table or a block of the documentation names exists."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from studies.__main__ import NAMES, parser_of
from tests.packaging.packages import ROOT

from iptm.commands.run import build_parser

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
QUOTED = re.compile(r'"(--[a-z][a-z-]+)"')
PAGES = [
    *ROOT.glob("*.md"),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "studies").rglob("README.md")),
]
FOREIGN = {
    # ros2, colcon, rosdep
    "--ros-args", "--show-args", "--enclave", "--exclude-topics",
    "--from-paths", "--ignore-src", "--skip-keys", "--clock",
    # pip, venv, cmake, SUMO
    "--require-hashes", "--no-deps", "--system-site-packages", "--build", "--fcd-output",
    # rosbags-convert
    "--src", "--dst", "--dst-storage",
}  # fmt: skip


@cache
def known_options() -> set[str]:
    """Return the options of all programs: of their parsers, and of the scripts."""
    known = {name for action in build_parser()._actions for name in action.option_strings}
    for script in (ROOT / "scripts").rglob("*"):
        if script.is_file():
            lines = script.read_text(encoding="utf-8").splitlines()
            known |= {
                name
                for line in lines
                if not line.lstrip().startswith("#")
                for name in OPTION.findall(line)
            }
    for name in NAMES:
        known |= set(parser_of(name)._option_string_actions)
    for folder in ("ros2_ws/src", "studies", "docs"):
        for file in (ROOT / folder).rglob("*.py"):
            known |= set(QUOTED.findall(file.read_text(encoding="utf-8")))
    return known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_options_of_a_page_exist(page: Path) -> None:
    if page.name == "CHANGELOG.md":
        pytest.skip("options of earlier versions")
    named = set(OPTION.findall(page.read_text(encoding="utf-8")))
    assert named - known_options() - FOREIGN == set()

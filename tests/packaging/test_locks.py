"""The lock files pin everything, fit one another, and betray no index and no machine."""

import functools
import re
from pathlib import Path

import pytest
from tests.packaging.packages import ROOT

FOLDER = ROOT / "requirements"
LOCKS = sorted(path.stem for path in FOLDER.glob("*.txt"))

PIN = re.compile(
    r"(?P<name>[a-z0-9][a-z0-9-]*)(?:\[[a-z0-9, -]+\])?==(?P<version>[\w.!+]+)(?: ; (?P<marker>[^\\]+?))?"
)


@functools.cache
def pins(lock: str) -> dict[tuple[str, str], str]:
    """Version by (name, marker); fails on any line that is neither a pin nor a hash."""
    text = (FOLDER / f"{lock}.txt").read_text(encoding="utf-8").replace("\\\n", "\\")
    found: dict[tuple[str, str], str] = {}
    for line in text.splitlines():
        requirement, *hashes = [part.strip() for part in line.split("\\")]
        match = PIN.fullmatch(requirement)
        assert match is not None, f"{lock}.txt: not a pinned version: {requirement!r}"
        assert hashes, f"{lock}.txt: {requirement} has no hash"
        for entry in hashes:
            assert re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", entry), f"{lock}.txt: {entry!r}"
        found[match["name"], match["marker"] or ""] = match["version"]
    return found


@pytest.mark.parametrize("lock", LOCKS)
def test_named_requirements_are_pinned_with_hashes(lock: str) -> None:
    locked = {name for name, _ in pins(lock)}

    def named(file: Path) -> set[str]:
        names: set[str] = set()
        for line in file.read_text(encoding="utf-8").splitlines():
            text = line.split("#")[0].strip()
            if text.startswith("-r "):
                names |= named(FOLDER / text[3:])
            elif text and not text.startswith("-c "):
                names.add(re.split(r"[\[=<>~!; ]", text)[0].lower())
        return names

    assert named(FOLDER / f"{lock}.in") <= locked, "run scripts/dev locks"


def test_locks_agree_on_versions() -> None:
    """`pip install -r run.txt -r dev.txt` must not be asked for two versions of one package."""
    versions: dict[str, set[frozenset[str]]] = {}
    for lock in LOCKS:
        chosen: dict[str, set[str]] = {}
        for (name, _), version in pins(lock).items():
            chosen.setdefault(name, set()).add(version)
        for name, found in chosen.items():
            versions.setdefault(name, set()).add(frozenset(found))
    assert {name: found for name, found in versions.items() if len(found) > 1} == {}


def test_sourced_ros_gets_no_wheels_of_ros() -> None:
    assert [name for name, _ in pins("run-no-ros") if name.startswith("ros-")] == []


def test_ros_distribution_is_jazzy() -> None:
    run = {name for name, _ in pins("run")}
    assert "ros-jazzy-rclpy" in run
    # The middleware is an extra of the rclpy wheel; without it, rclpy does not import.
    assert "ros-rmw-fastrtps-cpp" in run

"""The version: one command writes it wherever it stands. The release itself takes minutes and the network."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from tests.packaging.packages import FOLDERS, ROOT

NEW = "9.8.7"


def versions(root: Path) -> dict[str, str]:
    """Version by the file that states it."""
    places = {
        "pyproject.toml": r'^version = "(.*)"$',
        "CITATION.cff": r"^version: (.*)$",
        "ros2_ws/src/iptm/iptm/__init__.py": r'^__version__ = "(.*)"$',
    }
    for folder in FOLDERS.values():
        where = folder.relative_to(ROOT).as_posix()
        places[f"{where}/setup.py"] = r'^    version="(.*)",$'
        places[f"{where}/package.xml"] = r"^  <version>(.*)</version>$"
    found = {}
    for name, pattern in places.items():
        (found[name],) = re.findall(pattern, (root / name).read_text("utf-8"), re.MULTILINE)
    return found


def test_every_file_states_one_version() -> None:
    assert len(set(versions(ROOT).values())) == 1


def test_one_command_writes_the_version_everywhere(tmp_path: Path) -> None:
    for name in (*versions(ROOT), "scripts/dev", "scripts/internal/common.sh"):
        copy = tmp_path / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((ROOT / name).read_bytes())
        copy.chmod(0o755)
    subprocess.run([tmp_path / "scripts/dev", "version", NEW], check=True, timeout=300)
    assert set(versions(tmp_path).values()) == {NEW}


def test_a_version_that_is_none_is_refused() -> None:
    done = subprocess.run(
        [ROOT / "scripts/dev", "version", "next"],
        capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 1
    assert "'next'" in done.stderr

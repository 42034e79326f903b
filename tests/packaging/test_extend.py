"""The page "Extend it": what it shows is inserted into a copy of the suite, and a trip is driven with it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from tests.packaging.packages import EXTRAS, FOLDERS, PACKAGES, ROOT

PAGE = (ROOT / "docs" / "how-to" / "extend.md").read_text(encoding="utf-8")
INSERTED = re.compile(
    r"^In \[\w+\.py\]\(\.\./\.\./(\S+)\), (before|behind) `([^`]+)`:[^`]*```(?:python|text)\n(.*?)```",
    re.DOTALL | re.MULTILINE,
)
DRIVE = """
import iptm
from iptm_ros.topics import TOPICS, Topic
short = {"duration_s": 30.0, "horizon": "3x1"}
own = {"base": "aging_cost_to_go", "current_weight_1_a2": 1.0}
runs = [iptm.simulate("us06", strategy=each, **short).frame for each in ("aging_cost_to_go", own)]
squares = [float((run.battery_power_w**2).sum()) for run in runs]
assert squares[1] < squares[0], squares
fault = iptm.Fault("leader_speed_share", 10.0, size=0.5, duration_s=10.0)
slower = iptm.simulate("us06", faults=[fault], **short).frame
assert (slower.speed_m_s != iptm.simulate("us06", **short).frame.speed_m_s).any()
assert TOPICS[Topic.ITERATIONS].unit == "1"
import iptm_controller.node
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The core with all that the page inserts, and the extra of the page."""
    root = tmp_path_factory.mktemp("suite")
    for name in PACKAGES:
        if name not in EXTRAS:
            shutil.copytree(FOLDERS[name], root / FOLDERS[name].relative_to(ROOT))
    blocks = INSERTED.findall(PAGE)
    assert len(blocks) == 8
    for path, side, anchor, code in blocks:
        text = (root / path).read_text(encoding="utf-8")
        (place,) = [found.start() for found in re.finditer(re.escape(anchor), text)]
        line = text.rindex("\n", 0, place) + 1 if side == "before" else text.index("\n", place) + 1
        start = text.rindex("\n", 0, place) + 1
        indented = textwrap.indent(code, " " * (len(text[start:]) - len(text[start:].lstrip(" "))))
        (root / path).write_text(text[:line] + indented + text[line:], encoding="utf-8")
    mine = root / "ros2_ws" / "src" / "iptm_mine" / "iptm_mine"
    mine.mkdir(parents=True)
    (mine / "__init__.py").touch()
    for name in ("extra_commands", "mean"):
        (code,) = re.findall(
            rf"^In \[?{name}\.py.*? of the new package:\n\n```python\n(.*?)```",
            PAGE,
            re.DOTALL | re.MULTILINE,
        )
        (mine / f"{name}.py").write_text(code, encoding="utf-8")
    return root


def run(root: Path, *command: str) -> str:
    paths = [str(path) for path in sorted((root / "ros2_ws" / "src").iterdir())]
    others = [
        path for path in os.environ["PYTHONPATH"].split(os.pathsep) if "ros2_ws/src" not in path
    ]
    done = subprocess.run(
        [sys.executable, *command],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([*paths, *others])},
        cwd=root, capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_term_a_fault_and_a_topic_work(copy: Path) -> None:
    run(copy, "-c", DRIVE)


def test_an_extra_adds_its_command(copy: Path) -> None:
    assert "print the mean speed" in run(copy, "-m", "iptm", "--help")
    assert run(copy, "-m", "iptm", "mean", "us06") == "us06: 21.5 m/s\n"


def test_a_law_is_an_argument() -> None:
    (law,) = re.findall(r"^```python\n(import iptm\n.*?)```", PAGE, re.DOTALL | re.MULTILINE)
    names: dict[str, object] = {}
    exec(law, names)  # noqa: S102  of our own page
    assert names["run"].frame.shape[0] == 61  # type: ignore[attr-defined]

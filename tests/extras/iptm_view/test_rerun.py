"""Rerun reads a bag of the suite; needs ``pip install rerun-sdk`` (0.41 was tried)."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.topics import Topic

NAMED_VALUES = (Topic.PLANT_STATE, Topic.COMMAND, Topic.SOLVE, Topic.ROAD_AHEAD)


def test_rerun_finds_every_topic_and_the_series_of_named_values(bag: Path, tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun_cli", reason="rerun-sdk is not installed")
    program = Path(rerun.__file__).with_name("rerun")
    (file,) = bag.glob("*.mcap")
    done = subprocess.run(
        [str(program), "mcap", "check", "--full", str(file)],
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    rows = re.findall(r"^(\S+) +(?:\d+|\?) +\d+ +(/\S+)", done.stdout, re.MULTILINE)
    assert {state for state, _ in rows} == {"ok"}
    with BagReader(bag) as reader:
        topics = set(reader.topics)
    found = {name for _, name in rows}
    assert topics | {f"/{topic.value}/position" for topic in NAMED_VALUES} <= found

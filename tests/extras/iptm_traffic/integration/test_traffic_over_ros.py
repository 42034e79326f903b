"""The ego in SUMO, plant, bridge and controller as processes of their own. Skipped without the extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("traci", reason="requirements/traffic.txt is not installed")
pytest.importorskip("sumo", reason="requirements/traffic.txt is not installed")

from iptm_bags.compare_bags import compare_bags
from iptm_bags.replay_check import check_node
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.trajectory_reader import read_trajectory

TICKS = 15
RUN_TIMEOUT_S = 240.0


def test_a_drive_in_traffic_over_ros_leaves_an_ordinary_bag(launcher: Any, tmp_path: Path) -> None:
    """Two drives at the same time, with one seed: the same messages to the last bit."""
    bag, again = tmp_path / "traffic", tmp_path / "again"
    drives = [
        launcher.start_module(
            "iptm_traffic.cli", "--duration-s", str(TICKS), "--bag", folder, name=folder.name
        )
        for folder in (bag, again)
    ]
    # Exit code 0: no collision, plant and SUMO agree to a millimetre, the bag is complete.
    for drive in drives:
        assert drive.wait(RUN_TIMEOUT_S) == 0, drive.stdout + drive.stderr
        assert "Stop lines passed" in drive.stdout
    for outcome in compare_bags(bag, again):
        assert outcome.agrees, outcome.divergence_text() or outcome
    with BagReader(bag) as reader:
        assert reader.topics["/v2x/datagrams"].message_count > 5 * TICKS
        assert reader.run_information().scenario == "traffic_following"
    trajectory = read_trajectory(bag)
    assert trajectory.time_s.tolist() == list(range(TICKS + 1))
    # The leader starts 15 m ahead; before it is heard, no vehicle is reported.
    assert trajectory.has_leader[-1]
    assert np.nanmin(trajectory.gap_m) == pytest.approx(15.0, abs=3.0)
    assert trajectory.position_m[-1] > 5.0
    # The bridge alone says the same again, from the recorded datagrams and the road beside the bag.
    for outcome in check_node(bag, "v2x_bridge"):
        assert outcome.agrees, outcome.divergence_text() or outcome

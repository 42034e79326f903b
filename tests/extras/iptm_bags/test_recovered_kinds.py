"""Recovery of bags of several files and of bags of earlier recorders."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.foreign_readers import assert_read_by_all, with_rosbags
from tests.iptm_ros.recording.test_foreign_readers import EXAMPLE
from tests.iptm_ros.recording.test_split_bags import SECOND_NS

from iptm_bags.recover import recover
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader


@pytest.mark.parametrize("left", [0, 8, 40, 0.5, 1.0])
def test_a_kill_around_a_change_of_files(left: float, split_bag: Path) -> None:
    (split_bag / "metadata.yaml").unlink()
    last = split_bag / "split_5.mcap"
    whole = last.read_bytes()
    last.write_bytes(whole[: left if isinstance(left, int) else int(left * len(whole))])
    with pytest.raises(BagError, match="iptm recover"):
        BagReader(split_bag)
    report = recover(split_bag)
    assert report.message_count >= 119
    with BagReader(report.output) as reader:
        assert reader.custom_data["late"] == "found out while driving"
        assert len(list(reader.raw_messages(["/a"], 0, 50 * SECOND_NS))) == 50


def test_recovery_removes_surplus_bytes_and_counts_them(old_bag: Path) -> None:
    report = recover(old_bag)
    counts = assert_read_by_all(report.output)
    assert list(with_rosbags(report.output)) == list(with_rosbags(EXAMPLE))
    states = counts["/plant/odometry"]
    note = (
        f"topic /plant/odometry: {140 * states} bytes after the ends of {states} messages removed"
    )
    assert note in str(report)
    assert report.lost_count == 0

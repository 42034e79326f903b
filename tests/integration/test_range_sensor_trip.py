"""Trips behind a leader that the range sensor of the plant measures, over ROS 2 in lock-step."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import iptm
from iptm_core.settings import LeaderSource, PreviewMode
from iptm_ros.recording.bag_reader import BagReader

TRIP = iptm.Trip.of("us06", duration_s=40.0, preview_mode=PreviewMode.NONE)


def test_measured_tracks_lead_as_the_cycle_does(tmp_path: Path) -> None:
    """The tracks are exact in a simulation, so the trip is the one without previews behind the cycle."""
    bag = tmp_path / "bag"
    measured = iptm.drive(
        TRIP.changed(leader_source=LeaderSource.RANGE_SENSOR), over="ros", bag=bag
    )
    known = iptm.drive(TRIP)
    assert not measured.problems
    for name in ("position_m", "speed_m_s", "cell_n_temperature_k"):
        np.testing.assert_allclose(
            getattr(measured.trajectory, name), getattr(known.trajectory, name), atol=1e-6
        )
    with BagReader(bag) as reader:
        assert reader.topics["/sensor/tracks"].message_count >= 41

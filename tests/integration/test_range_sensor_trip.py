"""Trips behind a leader that the range sensor of the plant measures, over ROS 2 in lock-step."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
from tests.integration.cam_ego import SENDER, free_port

import iptm
from iptm_core.settings import LeaderSource, PreviewMode
from iptm_ros.diagnostics import status_values
from iptm_ros.discovery import reserve_domain
from iptm_ros.recording.bag_reader import BagReader

DRIVE = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"

TRIP = iptm.Trip.of("us06", duration_s=40.0, preview_mode=PreviewMode.NONE)


def test_measured_tracks_lead_as_the_cycle_does(tmp_path: Path) -> None:
    """The tracks are exact in a simulation, so the trip is the one without previews behind the cycle.

    Behind a leader that starts off, solves take 50 to 80 iterations: the last digits of a track decide in
    which of them the solver stops, which moves the car by a millimetre.
    """
    bag = tmp_path / "bag"
    measured = iptm.drive(
        TRIP.changed(leader_source=LeaderSource.RANGE_SENSOR), over="ros", bag=bag
    )
    known = iptm.drive(TRIP)
    assert not measured.problems
    for name, bound in (("position_m", 2e-3), ("speed_m_s", 2e-3), ("cell_n_temperature_k", 1e-6)):
        one, other = (getattr(run.trajectory, name) for run in (measured, known))
        np.testing.assert_allclose(one, other, atol=bound)
        np.testing.assert_allclose(one[:33], other[:33], atol=1e-6)
    with BagReader(bag) as reader:
        assert reader.topics["/sensor/tracks"].message_count >= 41


def test_sensor_and_messages_agree_on_the_leader(launcher: Any, tmp_path: Path) -> None:
    """The plant measures the car that a sender drives: gap by the sensor, preview by the messages."""
    port, bag, ticks = free_port(), tmp_path / "bag", 15
    pace = "conditions.mode=real_time", "conditions.rate_factor=5"  # reports come once a second
    with reserve_domain() as domain:
        settings = {"leader_source": "range_sensor_and_cam", "cam_port": port}
        runner = launcher.start_module(
            "iptm.commands.run", "--cycle", DRIVE, "--duration-s", str(ticks), "--no-picture",
            "--domain", str(domain), "--output", bag,
            *(part for item in settings.items() for part in ("--set", "leader.{}={}".format(*item))),
            *(part for item in pace for part in ("--set", item)),
        )  # fmt: skip
        sender = launcher.start_module(
            SENDER, "--ros-args", "-p", f"to_port:={port}", "-p", f"cycle:={DRIVE}",
            name="sender", ROS_DOMAIN_ID=f"{domain}",
        )  # fmt: skip
        assert runner.wait(120.0) == 0, runner.stdout + runner.stderr
        assert sender.stop(signal.SIGINT) == 0
    with BagReader(bag) as reader:
        reports = [
            status_values(status)
            for raw in reader.raw_messages(["/diagnostics"])
            for status in reader.decode(raw).status
            if "v2x_bridge" in status.name
        ]
    joined = {key for report in reports for key in report if key.startswith("ticks_")}
    assert joined == {"ticks_agreed"}

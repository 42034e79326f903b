"""The chain ahead as a node: octets of two cars and a signal from a process, recorded, and replayed."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.extras.iptm_its.integration.chain_sender import SPEED_M_S, START_MS, TICKS
from tests.extras.iptm_its.roadside import LINE_M
from tests.integration.cam_ego import BRIDGE, Ego, free_port

from iptm_core.state import LeaderPreview
from iptm_ros.topics import TOPICS, Topic

RECORDER = "iptm_ros.recording.recorder_cli"
SENDER = "tests.extras.iptm_its.integration.chain_sender"
COMMON: dict[str, object] = {
    "leader_source": "cam",
    "cycle": "nycc",
    "chain_ahead": True,
    "roadside_messages": True,
    "trip_start_timestamp_ms": START_MS,
}


def bits(preview: LeaderPreview) -> bytes:
    arrays = preview.times_s, preview.positions_m, preview.speeds_m_s, preview.bounds_m
    return b"".join(array.tobytes() for array in arrays)


def driven(ego: Ego) -> list[LeaderPreview]:
    return [ego.tick(float(tick), SPEED_M_S * tick) for tick in range(TICKS)]


def test_octets_of_cars_and_a_signal_forecast_the_leader_and_are_replayed(
    launcher: Any, peer: Any, tmp_path: Path
) -> None:
    pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")
    ego, port, bag = Ego(peer), free_port(), tmp_path / "drive"
    recorder = launcher.start_module(RECORDER, bag, "--topics", TOPICS[Topic.DATAGRAMS].name)
    live = launcher.start_node(
        BRIDGE, parameters={**COMMON, "cam_port": port, "publish_datagrams": True}
    )
    ego.meet("recorder")
    sender = launcher.start_module(SENDER, str(port))
    assert sender.wait() == 0
    heard = driven(ego)
    last = heard[-1]
    values = ego.settled_values()
    assert values["predictor"] == "car_following"
    assert values["vehicles_ahead_of_leader"].startswith("messages ")
    assert values["spatem_accepted"] == str(TICKS)
    assert values["mapem_accepted"] == str(TICKS)
    # It follows the car ahead, and both stop at the red.
    assert last.at(last.times_s[:1] + 2.0)[0][0] - last.positions_m[0] == pytest.approx(
        40.0, abs=1.0
    )
    assert last.positions_m.max() < LINE_M
    assert np.diff(last.bounds_m).min() >= 0.0
    for process in (recorder, live):
        assert process.stop(signal.SIGINT) == 0

    peer.wait_until(lambda: not ego.state.get_subscription_count(), what="the bridge to leave")
    ego.leaders.clear()
    ego.previews.clear()
    ego.roads.clear()
    ego.statuses.clear()
    again = launcher.start_node(BRIDGE, parameters={**COMMON, "recorded_packets": bag})
    ego.meet()
    assert [bits(preview) for preview in driven(ego)] == [bits(preview) for preview in heard]
    assert again.stop(signal.SIGINT) == 0

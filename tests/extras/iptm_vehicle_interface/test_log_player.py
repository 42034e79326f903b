"""A recorded CAN log reaches the loopback bus of the vehicle interface, frame by frame."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("can", reason="requirements/can.txt is not installed")

from iptm_vehicle_interface.bus import open_bus
from iptm_vehicle_interface.log_player import main
from iptm_vehicle_interface.node_bench import free_ports


def test_the_frames_of_a_log_arrive_in_their_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "drive.log"
    frames = [f"(1600000000.0{k}0000) can0 12{k}#112233445566770{k}" for k in range(3)]
    log.write_text("\n".join(frames) + "\n")
    port = free_ports(os.getpid())
    listener = open_bus(f"udp:{port}")
    try:
        assert main([str(log), f"udp:{port}"]) == 0
        heard = [listener.recv(60.0) for _ in frames]
    finally:
        listener.shutdown()
    assert [each.arbitration_id for each in heard] == [0x120, 0x121, 0x122]
    assert [each.data[-1] for each in heard] == [0, 1, 2]
    assert capsys.readouterr().out == "3 frames sent\n"


def test_a_file_that_is_no_log_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "missing.blf"), "udp:43113"]) == 2
    assert capsys.readouterr().err.count("\n") == 1

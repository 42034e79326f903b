"""Parameters of the node of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import parameter
from iptm_core.settings import FrameSettings, SamplingSettings


@dataclass(frozen=True)
class VehicleNodeParameters(FrameSettings, SamplingSettings):
    """Parameters of the node: its groups, the last of the bases first, then its own."""

    vehicle: str = parameter("bench", "name of a shipped vehicle, or a folder with vehicle.yaml")
    bus: str = parameter(
        "udp:43113", "bus of the gateway as python-can names it, such as socketcan:can0"
    )
    shadow: bool = parameter(
        default=False, description="send nothing: decide beside a driver, and record it"
    )
    awaited_nodes: str = parameter(
        "controller, v2x_bridge",
        "names of the nodes whose end or halt makes the car inactive within 100 ms, separated by commas; "
        "empty for none",
    )
    record: str = parameter(
        "", "folder to create for raw frames, steps and decisions, to be replayed; empty for none"
    )
    capacity_loss_file: str = parameter(
        "",
        "file with the capacity losses of the cells, read at the start and written while driving; empty "
        "starts from the parameter set",
    )
    log: str = parameter("", "file for the figures of the drive as JSON; empty for none")

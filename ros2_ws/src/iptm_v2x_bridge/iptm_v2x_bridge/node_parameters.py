"""Parameters of the bridge node and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import parameter
from iptm_core.settings import PreviewSettings, RoadSettings
from iptm_v2x_bridge.source import CycleSource


@dataclass(frozen=True)
class BridgeNodeParameters(PreviewSettings, RoadSettings):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    initial_gap_m: float = parameter(
        15.0, "position of the leader at t = 0, the host being at 0", "m", 1.0, 500.0
    )
    expected_peers: int = parameter(
        0, "subscribers of v2x/leader_preview to wait for before the first answer", "", 0, 100
    )

    def build_source(self) -> CycleSource:
        """Return the leader on its road.

        Raises:
            RouteError: the cycle or its file is not usable.
        """
        return CycleSource(self.route(self.initial_gap_m))

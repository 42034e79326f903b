"""What this extra adds to the V2X bridge: see `iptm_v2x_bridge.its`."""

from __future__ import annotations

from iptm_core.routes.road_line import RoadLine
from iptm_its.captures import read_capture
from iptm_its.chain import ChainBridge
from iptm_its.pycrate_codec import specification
from iptm_its.signatures import Verifier, read_anchors
from iptm_its.table import RoadsideTable
from iptm_v2x_bridge.prediction.road_rules import RoadRules

__all__ = ["chain", "read_capture", "roadside_rules", "verifier"]

chain = ChainBridge
"""Forecasts the leader by the vehicles ahead of it."""


def verifier(trust_anchors: str, *, refuses_unverified: bool) -> Verifier:
    """Return what verifies signatures up to the certificates in a folder.

    Raises:
        ParameterError: cryptography is not installed, or the folder is not usable.
    """
    return Verifier(read_anchors(trust_anchors), refuses_unverified=refuses_unverified)


def roadside_rules(road: RoadLine, given: RoadRules) -> RoadsideTable:
    """Return the rules of a road as roadside stations send them.

    Raises:
        ParameterError: pycrate, which reads these messages, is not installed.
    """
    specification()
    return RoadsideTable(road, given)

"""Lanes of intersections (MAPEM of TS 103 301; SAE J2735 in the profile of ISO/TS 19091).

What is read: of lanes for vehicles their nodes, whether they lead to the intersection or away from it, and
the connected lanes with their signal groups. The first node of a lane that leads there is its stop line.
Left out and counted: lanes that are computed from others, and regional nodes. Road segments, speed limits,
restrictions, and all other lanes are not looked at.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from iptm_core.routes.road_line import step_m
from iptm_its.pycrate_codec import decode_fields, encode_fields
from iptm_its.spatem import IntersectionId, id_fields, intersection_id
from iptm_v2x_bridge.messages.packets import MessageKind
from iptm_v2x_bridge.rejections import LeftOut, Rejection

SCALE_DEG = 1e7
_LATITUDE, _LONGITUDE = 900_000_001, 1_800_000_001
_INGRESS, _EGRESS = 2, 1
_OFFSET_BITS = {10: "node-XY1", 11: "node-XY2", 12: "node-XY3", 13: "node-XY4", 14: "node-XY5"}
_LARGEST_NODE = "node-XY6"
_VEHICLE_LANE = {"sharedWith": (0, 10), "laneType": ("vehicle", (0, 8))}


@dataclass(frozen=True)
class Lane:
    """A lane for vehicles.

    Attributes:
        number: in its intersection.
        nodes_m: its middle, from the intersection on, m east and north of the reference point; two or more.
        leads_in: whether it leads to the intersection.
        leads_out: whether it leads away from it.
        connections: the lanes that it leads into, each with the signal group that lets vehicles pass, None
            without one.
    """

    number: int
    nodes_m: tuple[tuple[float, float], ...]
    leads_in: bool = False
    leads_out: bool = False
    connections: tuple[tuple[int, int | None], ...] = ()


@dataclass(frozen=True)
class IntersectionMap:
    """Lanes of one intersection.

    Attributes:
        intersection: which one.
        revision: counts the changes of the map, 0 to 127 and over again.
        latitude_deg: reference point.
        longitude_deg: reference point.
        lanes: its lanes.
        left_out: what of it was left out.
    """

    intersection: IntersectionId
    revision: int
    latitude_deg: float
    longitude_deg: float
    lanes: tuple[Lane, ...]
    left_out: tuple[LeftOut, ...] = ()


def decode_mapem(payload: bytes) -> tuple[IntersectionMap, ...] | Rejection:
    """Read a bare message, whose header has been looked at."""
    read = decode_fields(MessageKind.MAPEM, payload)
    if isinstance(read, Rejection):
        return read
    _, fields = read
    geometries = fields.get("intersections", ())
    placed = (geometry for geometry in geometries if not _has_no_place(geometry["refPoint"]))
    return tuple(map(_intersection, placed)) or Rejection.INCOMPLETE


def _has_no_place(point: dict[str, int]) -> bool:
    return point["lat"] == _LATITUDE or point["long"] == _LONGITUDE


def _intersection(fields: dict[str, Any]) -> IntersectionMap:
    left_out: list[LeftOut] = []
    place = fields["refPoint"]["lat"] / SCALE_DEG, fields["refPoint"]["long"] / SCALE_DEG
    lanes = [
        _lane(lane, place, left_out)
        for lane in fields["laneSet"]
        if lane["laneAttributes"]["laneType"][0] == "vehicle"
    ]
    return IntersectionMap(
        intersection_id(fields["id"]),
        fields["revision"],
        *place,
        tuple(lane for lane in lanes if lane is not None),
        tuple(left_out),
    )


def _lane(
    fields: dict[str, Any], place_deg: tuple[float, float], left_out: list[LeftOut]
) -> Lane | None:
    kind, nodes = fields["nodeList"]
    if kind != "nodes":
        left_out.append(LeftOut.COMPUTED_LANE)
        return None
    places_m: list[tuple[float, float]] = []
    east = north = 0
    for node in nodes:
        kind, delta = node["delta"]
        if kind == "regional":
            left_out.append(LeftOut.REGIONAL_NODE)
            return None
        if kind == "node-LatLon":
            metres = step_m(delta["lat"] / SCALE_DEG, delta["lon"] / SCALE_DEG, place_deg)
            east, north = (round(100.0 * value) for value in metres)
        else:
            east, north = east + delta["x"], north + delta["y"]
        places_m.append((east / 100.0, north / 100.0))
    direction, _ = fields["laneAttributes"]["directionalUse"]
    return Lane(
        number=fields["laneID"],
        nodes_m=tuple(places_m),
        leads_in=bool(direction & _INGRESS),
        leads_out=bool(direction & _EGRESS),
        connections=tuple(
            (entry["connectingLane"]["lane"], entry.get("signalGroup"))
            for entry in fields.get("connectsTo", ())
        ),
    )


def encode_mapem(station_id: int, intersections: Iterable[IntersectionMap]) -> bytes:
    """Return a message of a station as bits.

    Raises:
        MessageError: a value is outside the range of the standard.
    """
    geometries = [
        {
            "id": id_fields(entry.intersection),
            "revision": entry.revision,
            "refPoint": {
                "lat": round(entry.latitude_deg * SCALE_DEG),
                "long": round(entry.longitude_deg * SCALE_DEG),
            },
            "laneSet": [_lane_fields(lane) for lane in entry.lanes],
        }
        for entry in intersections
    ]
    content = {"msgIssueRevision": 0, "intersections": geometries}
    return encode_fields(MessageKind.MAPEM, station_id, content)


def _lane_fields(lane: Lane) -> dict[str, Any]:
    direction = _INGRESS * lane.leads_in + _EGRESS * lane.leads_out
    fields: dict[str, Any] = {
        "laneID": lane.number,
        "laneAttributes": {"directionalUse": (direction, 2), **_VEHICLE_LANE},
        "nodeList": ("nodes", list(_node_fields(lane.nodes_m))),
    }
    if lane.connections:
        fields["connectsTo"] = [
            {"connectingLane": {"lane": to_lane}}
            | ({} if group is None else {"signalGroup": group})
            for to_lane, group in lane.connections
        ]
    return fields


def _node_fields(nodes_m: Iterable[tuple[float, float]]) -> Iterable[dict[str, Any]]:
    before = (0, 0)
    for east_m, north_m in nodes_m:
        # Rounded as places, so that the errors of the steps do not add up.
        place = (round(100.0 * east_m), round(100.0 * north_m))
        x, y = place[0] - before[0], place[1] - before[1]
        before = place
        fits = (name for bits, name in _OFFSET_BITS.items() if _fits(x, bits) and _fits(y, bits))
        yield {"delta": (next(fits, _LARGEST_NODE), {"x": x, "y": y})}


def _fits(value: int, bits: int) -> bool:
    return -(1 << bits - 1) <= value < 1 << bits - 1

"""Roadside stations at the signals of the corridor: phases and lanes, encoded.

Each covers its own intersection. The lanes of the main road have one
signal group, the cross street has another one.
"""

from __future__ import annotations

import math

from iptm_core.routes.road_line import RoadLine, step_deg, step_m
from iptm_its.mapem import (
    SCALE_DEG,
    IntersectionMap,
    Lane,
    encode_mapem,
)
from iptm_its.spatem import (
    IntersectionPhases,
    Phase,
    SignalState,
    encode_spatem,
)
from iptm_traffic.network import (
    CLEARING_S,
    CROSS_STREET_M,
    CYCLE_S,
    MAIN_OPEN_S,
    YELLOW_S,
    Network,
)
from iptm_traffic.simulation import RADIO_RANGE_M
from iptm_v2x_bridge.messages.packets import ROADSIDE_UNIT, MessageKind, wrap
from iptm_v2x_bridge.prediction.road_rules import Signal

SENT_PHASES = 6
"""Two cycles of green, yellow and red."""
MAPS_EVERY_S = 1.0
"""Maps are sent so often; phases at every step."""
_MAIN_GROUP, _CROSS_GROUP = 1, 2
_LANE_WIDTH_M = 3.2
_CROSSING_M = 25.0
"""From the stop line to the lanes behind the intersection."""
_LANE_NODES_M = (0.0, 50.0, 150.0)
_STATION_BASE = 1_000_000


_Station = tuple[int, Signal, bytes]
"""Number and signal of one station, and its map."""


class RoadsideStations:
    """The stations in radio range of the ego, one at each signal."""

    def __init__(self, network: Network, road: RoadLine) -> None:
        """Set up the stations."""
        self._road = road
        self._stations: list[_Station] = []
        for number, signal in enumerate(network.signals, start=1):
            lanes = self._lanes(number, signal.stop_line_m)
            self._stations.append((number, signal, encode_mapem(_STATION_BASE + number, [lanes])))

    def datagrams(self, time_ms: int, ego_position_m: float) -> list[bytes]:
        """Return what the ego vehicle hears of them at an instant."""
        heard: list[bytes] = []
        for number, signal, lanes in self._stations:
            place_m = signal.stop_line_m
            if abs(place_m - ego_position_m) > RADIO_RANGE_M:
                continue
            phases = [_phases(number, signal, time_ms)]
            sent = [(MessageKind.SPATEM, encode_spatem(_STATION_BASE + number, phases))]
            if time_ms % round(1000.0 * MAPS_EVERY_S) == 0:
                sent.append((MessageKind.MAPEM, lanes))
            latitude, longitude, _ = self._road.locate(place_m)
            place_deg = float(latitude), float(longitude)
            station_id = _STATION_BASE + number
            heard += [
                wrap(payload, station_id, ROADSIDE_UNIT, time_ms, place_deg, port=kind.port)
                for kind, payload in sent
            ]
        return heard

    def _lanes(self, number: int, line_m: float) -> IntersectionMap:
        """Return the lanes of an intersection: the ego's road with two lanes, and one that crosses it."""
        latitude, longitude, heading = (float(value) for value in self._road.locate(line_m))
        # Offsets count from the reference point as it is sent.
        origin = (
            round(latitude * SCALE_DEG) / SCALE_DEG,
            round(longitude * SCALE_DEG) / SCALE_DEG,
        )

        def nodes(along_m: list[float], left_m: float) -> tuple[tuple[float, float], ...]:
            found = []
            for place_m in along_m:
                there_lat, there_lon, towards = self._road.locate(place_m)
                left = math.radians(float(towards) - 90.0)
                aside = left_m * math.sin(left), left_m * math.cos(left)
                place = step_deg(there_lat, there_lon, *aside)
                found.append(step_m(float(place[0]), float(place[1]), origin))
            return tuple(found)

        before = [line_m - back for back in _LANE_NODES_M]
        behind = [line_m + _CROSSING_M + on for on in _LANE_NODES_M]
        lanes = []
        for lane in range(2):
            to_lane = 3 + lane
            left_m = lane * _LANE_WIDTH_M
            connection = ((to_lane, _MAIN_GROUP),)
            lanes.append(
                Lane(1 + lane, nodes(before, left_m), leads_in=True, connections=connection)
            )
            lanes.append(Lane(to_lane, nodes(behind, left_m), leads_out=True))
        left = math.radians(heading - 90.0)
        ahead_e, ahead_n = nodes([line_m + 0.5 * _CROSSING_M], 0.0)[0]
        cross = tuple(
            (ahead_e + away * math.sin(left), ahead_n + away * math.cos(left))
            for away in (0.5 * _CROSSING_M, CROSS_STREET_M)
        )
        lanes.append(Lane(5, cross, leads_in=True, connections=((3, _CROSS_GROUP),)))
        return IntersectionMap((0, number), 0, *origin, tuple(lanes))


def _phases(number: int, signal: Signal, time_ms: int) -> IntersectionPhases:
    """Return the phases of an intersection from an instant (TimestampIts) on."""
    cross_s = CYCLE_S - MAIN_OPEN_S - 2.0 * (YELLOW_S + CLEARING_S)
    opens_s = signal.begins_at_s
    groups = {
        _MAIN_GROUP: (opens_s, MAIN_OPEN_S),
        _CROSS_GROUP: (opens_s + MAIN_OPEN_S + YELLOW_S + CLEARING_S, cross_s),
    }
    phases = {
        group: _phases_from(opens_s, open_for_s, time_ms / 1000.0)
        for group, (opens_s, open_for_s) in groups.items()
    }
    return IntersectionPhases((0, number), 0, time_ms, phases)


def _phases_from(opens_s: float, open_for_s: float, now_s: float) -> tuple[Phase, ...]:
    durations = (
        (SignalState.GREEN, open_for_s),
        (SignalState.YELLOW, YELLOW_S),
        (SignalState.RED, CYCLE_S - open_for_s - YELLOW_S),
    )
    begins = now_s - (now_s - opens_s) % CYCLE_S
    found: list[Phase] = []
    while len(found) < SENT_PHASES:
        for state, duration_s in durations:
            ends = begins + duration_s
            if ends > now_s and len(found) < SENT_PHASES:
                found.append(_phase(state, begins, ends))
            begins = ends
    return tuple(found)


def _phase(state: SignalState, begins_s: float, ends_s: float) -> Phase:
    """Return a phase of a plan that is kept; what lies between two steps of the wire is sent as a range."""
    tenths = round(10.0 * ends_s, 6)
    return Phase(
        state,
        starts_s=begins_s,
        min_end_s=math.floor(tenths) / 10.0,
        max_end_s=math.ceil(tenths) / 10.0,
        likely_end_s=ends_s,
    )

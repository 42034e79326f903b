"""SUMO's vehicles as stations: each sends encoded cooperative awareness messages.

Roadside stations, if any, send their messages as well.

The announced path of a vehicle is its motion in a rehearsal: the same simulation, with a car of SUMO's own
in the ego vehicle's place. A vehicle that departs from it announces none.
"""

from __future__ import annotations

import zlib

import numpy as np

from iptm_core.routes.road_line import RoadLine, step_deg
from iptm_core.state import NS_PER_MS, NS_PER_S, FloatArray
from iptm_traffic.roadside import RoadsideStations
from iptm_traffic.simulation import SumoNeighbours, TrafficSimulation
from iptm_v2x_bridge.messages.cam import ASSUMED_WIDTH_M, CamMessage, PredictedPath
from iptm_v2x_bridge.messages.packets import delta_time_ms
from iptm_v2x_bridge.sender import (
    HIGHEST_ACCELERATION_M_S2,
    POSITION_BOUND_M,
    packet_of,
)
from iptm_v2x_bridge.settings import SenderSettings, path_times_s

SAME_PLACE_M = 0.5
"""Distance from the rehearsed position beyond which a vehicle announces no path."""
PATH_BEHIND_M, PATH_AHEAD_M = 20.0, 250.0
"""Range around the ego vehicle in which a vehicle announces its path, as farther ones do not lead."""


Rehearsal = dict[str, FloatArray]
"""Motion of each vehicle in a rehearsal: trip times, fronts along the road, distances to its left; (3, n)."""


def rehearse(simulation: TrafficSimulation, duration_s: float) -> Rehearsal:
    """Drive a simulation without ego vehicle to its end and return what the vehicles of the main road did."""
    places: dict[str, list[tuple[float, float, float]]] = {}
    while simulation.time_s < duration_s:
        simulation.step()
        for name, (east, north) in simulation.main_road_places():
            places.setdefault(name, []).append((simulation.time_s, east, north))
    found = {}
    for name, some in places.items():
        times, east, north = np.array(some).T
        road = simulation.network.road
        found[name] = np.vstack([times, road.along_and_aside_m(east, north)])
    return found


class TrafficRadio:
    """What the vehicles around the ego vehicle send.

    Attributes:
        sent: how many messages there were so far.
    """

    def __init__(
        self,
        simulation: TrafficSimulation,
        road_line: RoadLine,
        rehearsal: Rehearsal | None = None,
        *,
        with_roadside: bool = False,
    ) -> None:
        """Set up the radio; it records all steps of the simulation from now on.

        Args:
            simulation: the traffic.
            road_line: the ego vehicle's road on Earth.
            rehearsal: future motion of the vehicles; None if they do not announce it.
            with_roadside: put roadside stations at the signals.
        """
        self._simulation, self._road_line, self._rehearsal = simulation, road_line, rehearsal
        self._roadside = RoadsideStations(simulation.network, road_line) if with_roadside else None
        self._ahead_s = path_times_s(SenderSettings.path_points, SenderSettings.path_length_s)
        self._path_sent: dict[str, float] = {}
        self._pending: list[tuple[int, SumoNeighbours, float]] = []
        self.sent = 0
        simulation.after_step = self._note
        self._note()

    def _note(self) -> None:
        around = self._simulation.neighbours()
        self._pending.append(
            (round(around.time_s * NS_PER_S), around, self._simulation.ego.position_m)
        )

    def take(
        self,
        after_ns: int | None = None,  # noqa: ARG002
        until_ns: int = 0,  # noqa: ARG002
    ) -> tuple[list[tuple[int, bytes]], int]:
        """Return the datagrams since the last call, with the trip times (ns) at which they were sent.

        None is lost; see `Radio.take`.
        """
        taken = []
        for sent_ns, around, ego_m in self._pending:
            sent_ms = sent_ns // NS_PER_MS
            sent = [packet_of(message, sent_ms) for message in self.messages(around, ego_m)]
            if self._roadside is not None:
                sent += self._roadside.datagrams(sent_ms, ego_m)
            taken += [(sent_ns, datagram) for datagram in sent]
        self._pending.clear()
        self.sent += len(taken)
        return taken, 0

    def messages(self, around: SumoNeighbours, ego_position_m: float) -> list[CamMessage]:
        """Return the messages of the vehicles at one instant."""
        latitudes, longitudes = self._on_earth(around.positions_m, around.lateral_m)
        limit = HIGHEST_ACCELERATION_M_S2
        accelerations = np.clip(around.accelerations_m_s2, -limit, limit)
        return [
            CamMessage(
                station_id=zlib.crc32(name.encode()),
                delta_time_ms=delta_time_ms(round(around.time_s * 1000.0)),
                latitude_deg=float(latitudes[row]),
                longitude_deg=float(longitudes[row]),
                heading_deg=float(around.headings_deg[row]),
                speed_m_s=float(around.speeds_m_s[row]),
                acceleration_m_s2=float(accelerations[row]),
                length_m=float(around.lengths_m[row]),
                width_m=ASSUMED_WIDTH_M,
                position_bound_m=POSITION_BOUND_M,
                path=self._path(around, row, ego_position_m),
            )
            for row, name in enumerate(around.names)
        ]

    def _path(
        self, around: SumoNeighbours, row: int, ego_position_m: float
    ) -> PredictedPath | None:
        if self._rehearsal is None:
            return None
        name, time_s = around.names[row], around.time_s
        drive = self._rehearsal.get(name)
        ahead_m = around.positions_m[row] - ego_position_m
        if drive is None or not -PATH_BEHIND_M < ahead_m < PATH_AHEAD_M:
            return None
        if time_s - self._path_sent.get(name, -np.inf) < 1.0 - 1e-9:
            return None
        times, along_m, aside_m = drive
        if not times[0] <= time_s < times[-1] - self._ahead_s[0]:
            return None
        for rehearsed_m, actual_m in ((along_m, around.positions_m), (aside_m, around.lateral_m)):
            if abs(np.interp(time_s, times, rehearsed_m) - actual_m[row]) > SAME_PLACE_M:
                return None
        self._path_sent[name] = time_s
        ahead_s = self._ahead_s[time_s + self._ahead_s <= times[-1]]
        at = time_s + ahead_s
        latitudes, longitudes = self._on_earth(
            np.interp(at, times, along_m), np.interp(at, times, aside_m)
        )
        return PredictedPath(ahead_s, latitudes, longitudes, confidence=0.95)

    def _on_earth(self, along_m: FloatArray, aside_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        latitudes, longitudes, headings = self._road_line.locate(along_m)
        left = np.radians(headings) - 0.5 * np.pi
        return step_deg(latitudes, longitudes, aside_m * np.sin(left), aside_m * np.cos(left))

"""The corridor as SUMO knows it after netconvert: the host's way through it, signals, and where things lie.

Positions along the road are those of SUMO on the host's lanes, junctions included, so that plant, SUMO and
messages speak of the same metres.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.routes.road_line import RoadLine, step_deg
from iptm_core.routes.slope import SlopeProfile
from iptm_core.state import FloatArray
from iptm_traffic.corridor import HOST_LANE, Corridor
from iptm_traffic.sumo_process import sumo_program
from iptm_v2x_bridge.prediction.signals import CyclicSignal, SignalPlan
from iptm_v2x_bridge.prediction.speed_limits import SpeedLimits

ORIGIN_DEG = (48.0, 10.0)
CYCLE_S = 80.0
MAIN_OPEN_S, YELLOW_S, CLEARING_S = 42.0, 4.0, 2.0
HOST_START_M = 60.0
"""Where on its first lane the host starts."""
_PHASES = ("main", "main yellow", "clearing", "cross", "cross yellow", "clearing")


@dataclass(frozen=True, eq=False)
class HostRoad:
    """The host's way: its lanes one after the other.

    Attributes:
        east_m: vertices of the lanes in SUMO's plane, shape (n,), n >= 2.
        north_m: shape (n,).
        heights_m: shape (n,).
        positions_m: positions of the vertices along the road, shape (n,), from 0.
        lane_starts_m: position of the beginning of each lane of the way, junctions included, by its name.
        stop_lines_m: positions of the stop lines, in driving order.
    """

    east_m: FloatArray
    north_m: FloatArray
    heights_m: FloatArray
    positions_m: FloatArray
    lane_starts_m: dict[str, float]
    stop_lines_m: tuple[float, ...]

    def along_and_aside_m(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Return position along the road and distance to its left of points, shape (2, m) of shape (m,)."""
        offset_e = east_m[:, None] - self.east_m[None, :-1]
        offset_n = north_m[:, None] - self.north_m[None, :-1]
        step_e, step_n = np.diff(self.east_m), np.diff(self.north_m)
        lengths = np.hypot(step_e, step_n)
        share = (offset_e * step_e + offset_n * step_n) / lengths**2
        # Both ends go on straight.
        share[:, 1:] = np.maximum(share[:, 1:], 0.0)
        share[:, :-1] = np.minimum(share[:, :-1], 1.0)
        away = np.hypot(offset_e - share * step_e, offset_n - share * step_n)
        best = np.argmin(away, axis=1)
        rows = np.arange(best.size)
        part = share[rows, best]
        along = self.positions_m[best] + part * np.diff(self.positions_m)[best]
        left = step_e[best] * offset_n[rows, best] - step_n[best] * offset_e[rows, best]
        return np.stack([along, left / lengths[best]])

    def road_line(self) -> RoadLine:
        """Return the road on Earth; its positions are those of this way.

        A road with grades is longer than its map; here its map is stretched to the length of the road.
        """
        headings = np.arctan2(np.diff(self.east_m), np.diff(self.north_m))
        lengths = np.diff(self.positions_m)
        latitudes, longitudes = [ORIGIN_DEG[0]], [ORIGIN_DEG[1]]
        for length, heading in zip(lengths.tolist(), headings.tolist(), strict=True):
            latitude, longitude = step_deg(
                latitudes[-1], longitudes[-1], length * np.sin(heading), length * np.cos(heading)
            )
            latitudes.append(float(latitude))
            longitudes.append(float(longitude))
        return RoadLine(np.array(latitudes), np.array(longitudes))

    def slope(self) -> SlopeProfile:
        """Return the slope along the road."""
        return SlopeProfile.from_elevations(self.positions_m, self.heights_m)


@dataclass(frozen=True, eq=False)
class Network:
    """The corridor, converted.

    Attributes:
        corridor: what it was made from.
        file: SUMO's network.
        road: the host's way.
        signals: in driving order, in trip time.
        limits: speed limits along the host's way.
    """

    corridor: Corridor
    file: Path
    road: HostRoad
    signals: tuple[CyclicSignal, ...]
    limits: SpeedLimits

    @property
    def plan(self) -> SignalPlan:
        """The signals as rules of the road."""
        return SignalPlan(self.signals)


def build_network(
    corridor: Corridor, folder: Path, opens_at_s: tuple[float, ...], before_trip_s: float
) -> Network:
    """Convert a corridor and write the programs of its signals.

    Args:
        corridor: the corridor.
        folder: for SUMO's files; ``signals.add.xml`` has the programs.
        opens_at_s: for each signal, a trip time at which the main road turns green.
        before_trip_s: SUMO's time at trip time 0.

    Raises:
        ScenarioError: SUMO is not installed, or does not understand its input.
    """
    nodes, edges = corridor.write(folder)
    file = folder / "corridor.net.xml"
    command = [
        *(str(sumo_program("netconvert")), "-n", str(nodes), "-e", str(edges), "-o", str(file)),
        *("--precision", "6", "--no-turnarounds", "true", "--offset.disable-normalization", "true"),
        *("--no-warnings", "true"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode != 0:
        raise ScenarioError(f"netconvert failed: {' '.join(done.stderr.split())[:500]}")
    net = ET.parse(file).getroot()  # noqa: S314  written by netconvert just now
    road = _host_road(net, corridor)
    signals = tuple(
        CyclicSignal(line_m, CYCLE_S, opens_s, MAIN_OPEN_S)
        for line_m, opens_s in zip(road.stop_lines_m, opens_at_s, strict=True)
    )
    _write_programs(net, corridor, folder, [opens_s + before_trip_s for opens_s in opens_at_s])
    starts = np.array([road.lane_starts_m[f"{edge}_{HOST_LANE}"] for edge in corridor.main_edges])
    limits = np.array([corridor.limit_m_s(block) for block in range(corridor.blocks)])
    return Network(corridor, file, road, signals, SpeedLimits(starts, limits))


def _host_road(net: ET.Element, corridor: Corridor) -> HostRoad:
    lanes = {lane.get("id", ""): lane for lane in net.iter("lane")}
    via = {
        (link.get("from"), link.get("to"), link.get("fromLane")): link.get("via", "")
        for link in net.iter("connection")
    }
    way: list[str] = []
    for edge, following in zip(corridor.main_edges, (*corridor.main_edges[1:], None), strict=True):
        way.append(f"{edge}_{HOST_LANE}")
        if following is not None:
            way.append(via[edge, following, str(HOST_LANE)])
    points: list[tuple[float, float, float]] = []
    positions: list[float] = [0.0]
    starts: dict[str, float] = {}
    ends: list[float] = []
    for name in way:
        lane = lanes[name]
        shape = np.array(
            [
                [*(float(value) for value in point.split(",")), 0.0][:3]
                for point in lane.get("shape", "").split()
            ]
        )
        steps = np.sqrt(np.sum(np.diff(shape, axis=0) ** 2, axis=1))
        # SUMO stretches a lane's shape to its length; what it says of positions is along the length.
        steps *= float(lane.get("length", "0")) / steps.sum()
        starts[name] = positions[-1]
        points.extend(map(tuple, shape[1:] if points else shape))
        positions.extend((positions[-1] + np.cumsum(steps)).tolist())
        ends.append(positions[-1])
    # Position 0 is where the host starts.
    along = np.array(positions) - HOST_START_M
    kept = along > 0.0
    first = [np.interp(0.0, along, values) for values in np.array(points).T]
    east, north, heights = (
        np.concatenate([[start], values[kept]])
        for start, values in zip(first, np.array(points).T, strict=True)
    )
    return HostRoad(
        east,
        north,
        heights,
        np.concatenate([[0.0], along[kept]]),
        {name: start_m - HOST_START_M for name, start_m in starts.items()},
        tuple(end_m - HOST_START_M for end_m in ends[0:-1:2]),
    )


def _write_programs(
    net: ET.Element, corridor: Corridor, folder: Path, opens_at_s: list[float]
) -> None:
    """Write the signals' programs in SUMO's time; links of the main road are open together."""
    root = ET.Element("additional")
    cross_s = CYCLE_S - MAIN_OPEN_S - 2.0 * (YELLOW_S + CLEARING_S)
    durations = (MAIN_OPEN_S, YELLOW_S, CLEARING_S, cross_s, YELLOW_S, CLEARING_S)
    for name, opens_s in zip(corridor.signals, opens_at_s, strict=True):
        links = sorted(
            (int(link.get("linkIndex", "0")), link)
            for link in net.iter("connection")
            if link.get("tl") == name
        )
        logic = ET.SubElement(root, "tlLogic", id=name, type="static", programID="plan")
        logic.set("offset", f"{opens_s % CYCLE_S:g}")
        for phase, duration_s in zip(_PHASES, durations, strict=True):
            state = "".join(_state(link, phase) for _, link in links)
            ET.SubElement(logic, "phase", duration=f"{duration_s:g}", state=state)
    ET.indent(root)
    ET.ElementTree(root).write(folder / "signals.add.xml", encoding="unicode")


def _state(link: ET.Element, phase: str) -> str:
    """Return the state of a link in SUMO's letters: G go, g go but yield, y yellow, r red."""
    is_main = link.get("from", "").startswith(("main", "oncoming"))
    own, _, rest = phase.partition(" ")
    if own != ("main" if is_main else "cross"):
        return "r"
    if rest:
        return "y"
    return "G" if link.get("dir") == "s" else "g"

"""The network that is driven in, and the corridor: a road with hills, bends, limits and signals for SUMO.

Everything is computed from a few numbers; no map is needed. Cross streets meet the main road at each signal.
"""

from __future__ import annotations

import math
import subprocess
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_core.road_ahead import SpeedLimits
from iptm_core.state import FloatArray
from iptm_traffic.ego_road import EgoRoad
from iptm_traffic.sumo_net import Link, SumoNet
from iptm_traffic.sumo_process import sumo_program
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal

BLOCK_M = 1100.0
"""Distance between two signals; the corridor has one more block than signals."""
MIN_BLOCKS = 8
"""9 km without the way to the start."""
MAX_BLOCKS = 200
LANES = 2
EGO_LANE = 0
CROSS_STREET_M = 250.0
LIMITS_KM_H = (50.0, 70.0, 50.0, 60.0)
"""Speed limits of the blocks, over and over."""
CROSS_LIMIT_KM_H = 50.0
_POINT_SPACING_M = 50.0
_BENDS = ((90.0, 2600.0), (25.0, 830.0))
_HILLS = ((9.0, 1900.0), (3.0, 610.0))
"""Amplitudes and wavelengths of bends (sideways) and hills (heights), m."""


@dataclass(frozen=True)
class Corridor:
    """A main road from west to east with ``blocks - 1`` signals.

    Attributes:
        blocks: stretches of `BLOCK_M` between signals.

    Raises:
        ScenarioError: too few or too many blocks.
    """

    blocks: int = MIN_BLOCKS

    def __post_init__(self) -> None:
        if not MIN_BLOCKS <= self.blocks <= MAX_BLOCKS:
            raise ScenarioError(
                f"corridor has {self.blocks} blocks; allowed: {MIN_BLOCKS} to {MAX_BLOCKS}"
            )

    @classmethod
    def long_enough_for(cls, duration_s: float) -> Corridor:
        """Return a corridor that lasts a trip of some duration at the lowest of its speed limits."""
        needed = math.ceil(duration_s * min(LIMITS_KM_H) / KM_H_PER_M_S / BLOCK_M) + 1
        return cls(max(MIN_BLOCKS, needed))

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signalised junctions, in driving order."""
        return tuple(f"signal_{number}" for number in range(1, self.blocks))

    @property
    def main_edges(self) -> tuple[str, ...]:
        """Names of the edges of the main road, in driving order."""
        return tuple(f"main_{number}" for number in range(self.blocks))

    @property
    def oncoming_edges(self) -> tuple[str, ...]:
        """Names of the edges of the opposite direction, in its driving order."""
        return tuple(f"oncoming_{number}" for number in reversed(range(self.blocks)))

    def limit_m_s(self, block: int) -> float:
        """Return the speed limit of a block."""
        return LIMITS_KM_H[block % len(LIMITS_KM_H)] / KM_H_PER_M_S

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write nodes and edges as plain XML and return the two files."""
        nodes, edges = ET.Element("nodes"), ET.Element("edges")
        junctions = ("start", *self.signals, "end")
        for number, name in enumerate(junctions):
            x = number * BLOCK_M
            kind = "traffic_light" if name in self.signals else "priority"
            _node(nodes, name, (x, _y(x), _z(x)), kind)
            if name in self.signals:
                for side, direction in (("north", 1.0), ("south", -1.0)):
                    place = (x, _y(x) + direction * CROSS_STREET_M, _z(x))
                    _node(nodes, f"{side}_{number}", place, "priority")
                    for way, ends in (
                        ("in", (f"{side}_{number}", name)),
                        ("out", (name, f"{side}_{number}")),
                    ):
                        _edge(
                            edges,
                            f"{side}_{way}_{number}",
                            ends,
                            1,
                            CROSS_LIMIT_KM_H / KM_H_PER_M_S,
                        )
        for block in range(self.blocks):
            inside = np.arange(_POINT_SPACING_M, BLOCK_M, _POINT_SPACING_M) + block * BLOCK_M
            ends = (junctions[block], junctions[block + 1])
            limit = self.limit_m_s(block)
            whole = np.concatenate([[block * BLOCK_M], inside, [(block + 1) * BLOCK_M]])
            _edge(edges, f"main_{block}", ends, LANES, limit, whole)
            _edge(edges, f"oncoming_{block}", ends[::-1], 1, limit, whole[::-1])
        files = (folder / "corridor.nod.xml", folder / "corridor.edg.xml")
        for file, root in zip(files, (nodes, edges), strict=True):
            ET.indent(root)
            ET.ElementTree(root).write(file, encoding="unicode")
        return files


def _y(x: float) -> float:
    return sum(a * (1.0 - math.cos(2.0 * math.pi * x / w)) for a, w in _BENDS)


def _z(x: float) -> float:
    return sum(a * math.sin(2.0 * math.pi * x / w) for a, w in _HILLS)


def _node(parent: ET.Element, name: str, place_m: tuple[float, float, float], kind: str) -> None:
    x, y, z = (f"{value:.3f}" for value in place_m)
    ET.SubElement(parent, "node", id=name, x=x, y=y, z=z, type=kind)


def _edge(
    parent: ET.Element,
    name: str,
    ends: tuple[str, str],
    lanes: int,
    limit_m_s: float,
    along_m: FloatArray | None = None,
) -> None:
    edge = ET.SubElement(
        parent,
        "edge",
        {"id": name, "from": ends[0], "to": ends[1]},
        numLanes=str(lanes),
        speed=f"{limit_m_s:.6f}",
    )
    if along_m is not None:
        points = [f"{x:.3f},{_y(x):.3f},{_z(x):.3f}" for x in along_m.tolist()]
        edge.set("shape", " ".join(points))


CYCLE_S = 80.0
MAIN_OPEN_S, YELLOW_S, CLEARING_S = 42.0, 4.0, 2.0
EGO_START_M = 60.0
"""Where on its first lane the ego vehicle starts."""
_PHASES = ("main", "main yellow", "clearing", "cross", "cross yellow", "clearing")


@dataclass(frozen=True, eq=False)
class Network:
    """A network, and the ego vehicle's way through it.

    Attributes:
        net: SUMO's network.
        options: SUMO's command line for network and traffic.
        way: the ego vehicle's way, link by link.
        edges: its edges.
        start_m: where on its first lane the ego vehicle starts.
        start_s: SUMO's time at trip time 0.
        instead_of: the vehicle whose place the ego vehicle takes; empty for none.
        road: the ego vehicle's way as a road.
        limits: speed limits along it.
        signals: those with plans that are known beforehand, in driving order, in trip time.
    """

    net: SumoNet
    options: tuple[str, ...]
    way: tuple[Link, ...]
    edges: tuple[str, ...]
    start_m: float
    start_s: float
    instead_of: str
    road: EgoRoad
    limits: SpeedLimits
    signals: tuple[Signal, ...] = ()

    @property
    def rules(self) -> RoadRules:
        """Limits and signals as rules of the road."""
        return RoadRules(self.limits, self.signals)


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
    options = ["-n", str(nodes), "-e", str(edges), "--precision", "6"]
    netconvert(
        [*options, "--no-turnarounds", "true", "--offset.disable-normalization", "true"], file
    )
    net = SumoNet(file)
    way = net.way(corridor.main_edges)
    road = EgoRoad.of_way(net, way, EGO_START_M)
    signals = tuple(
        Signal.cyclic(line_m, CYCLE_S, opens_s, MAIN_OPEN_S)
        for line_m, opens_s in zip(road.stop_lines_m, opens_at_s, strict=True)
    )
    programs = folder / "signals.add.xml"
    _write_programs(file, corridor, programs, [opens_s + before_trip_s for opens_s in opens_at_s])
    lanes = (way[0].from_lane, *(link.to_lane for link in way))
    starts = np.array([road.lane_starts_m[lane][0] for lane in lanes])
    limits = np.array([corridor.limit_m_s(block) for block in range(corridor.blocks)])
    return Network(
        net=net,
        options=("-n", str(file), "-a", str(programs)),
        way=way,
        edges=corridor.main_edges,
        start_m=EGO_START_M,
        start_s=before_trip_s,
        instead_of="",
        road=road,
        limits=SpeedLimits(starts, limits),
        signals=signals,
    )


def netconvert(options: list[str], file: Path) -> None:
    """Make a network.

    Raises:
        ScenarioError: SUMO is not installed, or does not understand the input.
    """
    command = [str(sumo_program("netconvert")), *options, "-o", str(file), "--no-warnings", "true"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode != 0:
        raise ScenarioError(f"netconvert failed: {' '.join(done.stderr.split())[:500]}")


def _write_programs(file: Path, corridor: Corridor, to: Path, opens_at_s: list[float]) -> None:
    """Write the signals' programs in SUMO's time; links of the main road are open together."""
    net = ET.parse(file).getroot()  # noqa: S314  written by netconvert just now
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
    ET.ElementTree(root).write(to, encoding="unicode")


def _state(link: ET.Element, phase: str) -> str:
    """Return the state of a link in SUMO's letters: G go, g go but yield, y yellow, r red."""
    is_main = link.get("from", "").startswith(("main", "oncoming"))
    own, _, rest = phase.partition(" ")
    if own != ("main" if is_main else "cross"):
        return "r"
    if rest:
        return "y"
    return "G" if link.get("dir") == "s" else "g"

"""The network that is driven in, and the corridor: a road with hills, bends, limits and signals for SUMO."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.road_ahead import SpeedLimits
from iptm_core.units import KM_H_PER_M_S
from iptm_traffic.ego_road import EgoRoad
from iptm_traffic.sumo_net import Link, SumoNet
from iptm_traffic.sumo_process import sumo_program
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal

CORRIDOR = Path(__file__).parent / "corridor"
"""Folder of the corridor's nodes and edges: a road with hills, bends and cross streets, from west to east."""
BLOCK_M = 1100.0
"""Distance between two signals; the corridor has one more block than signals."""
BLOCKS = 9
SIGNALS = tuple(f"signal_{number}" for number in range(1, BLOCKS))
"""Names of the signalised junctions, in driving order."""
MAIN_EDGES = tuple(f"main_{number}" for number in range(BLOCKS))
"""Names of the edges of the main road, in driving order."""
ONCOMING_EDGES = tuple(f"oncoming_{number}" for number in reversed(range(BLOCKS)))
"""Names of the edges of the opposite direction, in its driving order."""
EGO_LANE = 0
CROSS_STREET_M = 250.0
LIMITS_KM_H = (50.0, 70.0, 50.0, 60.0)
"""Speed limits of the blocks, over and over, as in the file of the edges."""
LONGEST_TRIP_S = (BLOCKS - 1) * BLOCK_M / (min(LIMITS_KM_H) / KM_H_PER_M_S)
"""A trip at the lowest of the limits does not reach the end of the corridor."""


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


def build_network(folder: Path, opens_at_s: tuple[float, ...], before_trip_s: float) -> Network:
    """Convert the corridor and write the programs of its signals.

    Args:
        folder: for SUMO's files; ``signals.add.xml`` has the programs.
        opens_at_s: for each signal, a trip time at which the main road turns green.
        before_trip_s: SUMO's time at trip time 0.

    Raises:
        ScenarioError: SUMO is not installed, or does not understand its input.
    """
    nodes, edges = (CORRIDOR / f"corridor.{part}.xml" for part in ("nod", "edg"))
    file = folder / "corridor.net.xml"
    options = ["-n", str(nodes), "-e", str(edges), "--precision", "6"]
    netconvert(
        [*options, "--no-turnarounds", "true", "--offset.disable-normalization", "true"], file
    )
    net = SumoNet(file)
    way = net.way(MAIN_EDGES)
    road = EgoRoad.of_way(net, way, EGO_START_M)
    signals = tuple(
        Signal.cyclic(line_m, CYCLE_S, opens_s, MAIN_OPEN_S)
        for line_m, opens_s in zip(road.stop_lines_m, opens_at_s, strict=True)
    )
    programs = folder / "signals.add.xml"
    _write_programs(file, programs, [opens_s + before_trip_s for opens_s in opens_at_s])
    lanes = (way[0].from_lane, *(link.to_lane for link in way))
    starts = np.array([road.lane_starts_m[lane][0] for lane in lanes])
    limits = np.resize(LIMITS_KM_H, BLOCKS) / KM_H_PER_M_S
    return Network(
        net=net,
        options=("-n", str(file), "-a", str(programs)),
        way=way,
        edges=MAIN_EDGES,
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


def _write_programs(file: Path, to: Path, opens_at_s: list[float]) -> None:
    """Write the signals' programs in SUMO's time; links of the main road are open together."""
    net = ET.parse(file).getroot()  # noqa: S314  written by netconvert just now
    root = ET.Element("additional")
    cross_s = CYCLE_S - MAIN_OPEN_S - 2.0 * (YELLOW_S + CLEARING_S)
    durations = (MAIN_OPEN_S, YELLOW_S, CLEARING_S, cross_s, YELLOW_S, CLEARING_S)
    for name, opens_s in zip(SIGNALS, opens_at_s, strict=True):
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

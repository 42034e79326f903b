"""The corridor: a road with hills, bends, speed limits and signals, as plain XML for SUMO's netconvert.

Everything is computed from a few numbers; no map is needed. Cross streets meet the main road at each signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_core.state import FloatArray

BLOCK_M = 1100.0
"""Distance between two signals; the corridor has one more block than signals."""
MIN_BLOCKS = 8
"""9 km without the way to the start."""
MAX_BLOCKS = 200
LANES = 2
HOST_LANE = 0
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

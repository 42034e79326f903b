"""A network file of SUMO: its lanes, the links between them, and the right of way at them."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray

_CAR = "passenger"


@dataclass(frozen=True, eq=False)
class SumoLane:
    """A lane.

    Attributes:
        name: SUMO's.
        length_m: length that SUMO's positions on it refer to.
        limit_m_s: speed limit.
        shape_m: east, north and height of its vertices, shape (n, 3), n >= 2.
        for_cars: passenger cars may use it.
    """

    name: str
    length_m: float
    limit_m_s: float
    shape_m: FloatArray
    for_cars: bool


@dataclass(frozen=True)
class Link:
    """A way from one lane to the next across a junction.

    Attributes:
        from_lane: name of the lane that ends at the junction.
        to_lane: name of the lane behind it.
        inside: names of the lanes across the junction, one after the other: two where cars wait inside.
        signal: name of the traffic light, empty for none.
        signal_index: the link's letter in the states of the traffic light.
        junction: name of the junction.
        index: the link's number at the junction.
    """

    from_lane: str
    to_lane: str
    inside: tuple[str, ...]
    signal: str
    signal_index: int
    junction: str
    index: int


@dataclass(frozen=True)
class Junction:
    """Right of way at a junction.

    Attributes:
        lanes_inside: last inner lanes of its links, and crossings, by their numbers.
        yields_to: for each link, the numbers of those it has to yield to.
        conflicts: for each link, the numbers of those whose way it shares or crosses.
    """

    lanes_inside: tuple[str, ...]
    yields_to: tuple[frozenset[int], ...]
    conflicts: tuple[frozenset[int], ...]


class SumoNet:
    """What a network file holds.

    Attributes:
        lanes: by name.
        edges: names of the lanes of each edge, the outermost first; inner edges and crossings, too.
        links: by the lane that they come from.
        inside: links by the lanes across the junction.
        junctions: by name.
        crossing_lights: traffic light of the crossings that have one, and their letter in its states.
        crossings: edges on which people cross.
        areas: edges in which people walk between crossings and sidewalks.
        walks: for each area and each crossing, the lanes from which it is walked to.
    """

    def __init__(self, file: Path) -> None:
        """Read a file.

        Raises:
            ScenarioError: it cannot be read, or is not a network.
        """
        try:
            with (gzip.open if file.suffix == ".gz" else open)(file, "rb") as stream:
                root = ET.parse(stream).getroot()  # noqa: S314  expat refuses entity bombs
        except (OSError, ET.ParseError) as reason:
            raise ScenarioError(f"{file} cannot be read as a network: {reason}") from reason
        if root.tag != "net":
            raise ScenarioError(f"{file} holds <{root.tag}>; allowed: a network of SUMO, <net>")
        self.lanes: dict[str, SumoLane] = {}
        self.edges: dict[str, tuple[str, ...]] = {}
        functions: dict[str, set[str]] = {"crossing": set(), "walkingarea": set()}
        for edge in root.iter("edge"):
            functions.setdefault(edge.get("function", ""), set()).add(edge.get("id", ""))
            lanes = [_lane(lane) for lane in edge.iter("lane")]
            self.edges[edge.get("id", "")] = tuple(lane.name for lane in lanes)
            self.lanes.update((lane.name, lane) for lane in lanes)
        self.crossings, self.areas = functions["crossing"], functions["walkingarea"]
        self.junctions = {
            junction.get("id", ""): _junction(junction)
            for junction in root.iter("junction")
            if junction.get("type") != "internal"
        }
        connections = {
            (_end(entry, "from"), _end(entry, "to")): entry for entry in root.iter("connection")
        }
        self.crossing_lights = {
            self.edge_of(end): (entry.get("tl", ""), int(entry.get("linkIndex", "0")))
            for (_, end), entry in connections.items()
            if self.edge_of(end) in self.crossings and entry.get("tl")
        }
        self.walks: dict[str, set[str]] = {}
        for start, end in connections:
            if {self.edge_of(start), self.edge_of(end)} & self.areas:
                self.walks.setdefault(self.edge_of(start), set()).add(end)
                self.walks.setdefault(self.edge_of(end), set()).add(start)
        self.links: dict[str, list[Link]] = {}
        self.inside: dict[str, Link] = {}
        self._link(connections)

    def _link(self, connections: dict[tuple[str, str], ET.Element]) -> None:
        numbers = {
            lane: (name, index)
            for name, junction in self.junctions.items()
            for index, lane in enumerate(junction.lanes_inside)
        }
        onward = {ends: entry.get("via", "") for ends, entry in connections.items()}
        for (start, end), entry in connections.items():
            via = entry.get("via", "")
            if start.startswith(":") or not via:
                continue
            inside = [via]
            while following := onward.get((inside[-1], end), ""):
                inside.append(following)
            if inside[-1] not in numbers:
                continue
            signal = entry.get("tl", "")
            light = int(entry.get("linkIndex", "0"))
            found = Link(start, end, tuple(inside), signal, light, *numbers[inside[-1]])
            self.links.setdefault(start, []).append(found)
            self.inside.update(dict.fromkeys(inside, found))

    @staticmethod
    def edge_of(lane: str) -> str:
        """Return the edge of a lane."""
        return lane.rpartition("_")[0]

    def length_inside_m(self, link: Link) -> float:
        """Return the length of a link."""
        return sum(self.lanes[name].length_m for name in link.inside)

    def way(self, edges: tuple[str, ...]) -> tuple[Link, ...]:
        """Return the links of a way along edges on which a car never changes its lane.

        Of several such ways, the outermost one.

        Raises:
            ScenarioError: an edge does not exist, or the edges are not connected.
        """
        if len(edges) < 2:
            raise ScenarioError(
                f"the ego vehicle's route is {' '.join(edges)!r}; allowed: at least two edges"
            )
        for edge in edges:
            if edge not in self.edges or edge.startswith(":"):
                raise ScenarioError(
                    f"edge {edge!r} of the ego vehicle's route is not in the network"
                )
        good = {name for name in self.edges[edges[-1]] if self.lanes[name].for_cars}
        options: list[list[Link]] = []
        for here, following in reversed(list(pairwise(edges))):
            options.append(
                [
                    link
                    for name in self.edges[here]
                    if self.lanes[name].for_cars
                    for link in self.links.get(name, [])
                    if link.to_lane in good
                ]
            )
            if not options[-1]:
                raise ScenarioError(
                    f"no lane of edge {here!r} leads on to {following!r} and along the rest of the ego's "
                    "route; allowed: connected edges, without a change of lanes"
                )
            good = {link.from_lane for link in options[-1]}
        way: list[Link] = []
        for choices in reversed(options):
            ends = way[-1].to_lane if way else choices[0].from_lane
            way.append(next(link for link in choices if link.from_lane == ends))
        return tuple(way)


def _lane(entry: ET.Element) -> SumoLane:
    shape = [
        [*(float(value) for value in point.split(",")), 0.0][:3]
        for point in entry.get("shape", "").split()
    ]
    only, never = entry.get("allow"), entry.get("disallow", "").split()
    for_cars = _CAR in only.split() or only == "all" if only else not {_CAR, "all"} & set(never)
    length_m, limit_m_s = float(entry.get("length", "0")), float(entry.get("speed", "0"))
    return SumoLane(entry.get("id", ""), length_m, limit_m_s, np.array(shape), for_cars)


def _junction(entry: ET.Element) -> Junction:
    rows = sorted(entry.iter("request"), key=lambda row: int(row.get("index", "0")))
    # A junction without any conflict may list none.
    return Junction(
        tuple(entry.get("intLanes", "").split()),
        tuple(frozenset(_bits(row.get("response", ""))) for row in rows),
        tuple(frozenset(_bits(row.get("foes", ""))) for row in rows),
    )


def _bits(text: str) -> Iterator[int]:
    """Yield the places of the ones, counted from the right."""
    return (place for place, bit in enumerate(reversed(text)) if bit == "1")


def _end(entry: ET.Element, end: str) -> str:
    return f"{entry.get(end)}_{entry.get(f'{end}Lane')}"

"""A network of the user's own: files of SUMO or OpenStreetMap, and the way that the ego takes through it."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

from iptm_core.errors import ScenarioError
from iptm_traffic.demand import EGO_KIND, ego_kind
from iptm_traffic.ego_road import EgoRoad
from iptm_traffic.network import Network, netconvert
from iptm_traffic.simulation import step_options
from iptm_traffic.sumo_net import SumoNet
from iptm_traffic.sumo_process import SumoProcess

DEPART_S = 120.0
"""When the ego vehicle departs on a route of its own: by then there is traffic."""
LONGEST_SEARCH_S = 4 * 3600.0
"""A vehicle that the ego vehicle is to take the place of departs within this time."""
_STARTS_AT_M = 6.0
_NAMES_SHOWN = 5
_OSM_OPTIONS = (
    *("--geometry.remove", "true", "--roundabouts.guess", "true", "--ramps.guess", "true"),
    *("--junctions.join", "true", "--tls.guess-signals", "true", "--tls.join", "true"),
    *("--sidewalks.guess", "true", "--crossings.guess", "true"),
)
"""What SUMO's documentation recommends for networks from OpenStreetMap, with sidewalks and crossings."""


@dataclass(frozen=True)
class OwnNetwork:
    """What the user gives.

    Attributes:
        net: network (``.net.xml``, ``.net.xml.gz``), configuration of SUMO (``.sumocfg``) or of netconvert
            (``.netccfg``), or map (``.osm``).
        routes: files with vehicles and persons, after the ones of the configuration, if there is one.
        ego: the vehicle whose place the ego vehicle takes; empty for a route.
        ego_route: edges of the ego vehicle's way; between two that do not touch it takes the shortest way.
        depart_s: SUMO's time from which on the ego vehicle departs on its route.
        seed: SUMO's.

    Raises:
        ScenarioError: a file is not there, or neither or both of vehicle and route are given.
    """

    net: Path
    routes: tuple[Path, ...] = ()
    ego: str = ""
    ego_route: tuple[str, ...] = ()
    depart_s: float = DEPART_S
    seed: int = 1

    def __post_init__(self) -> None:
        for file in (self.net, *self.routes):
            if not file.is_file():
                raise ScenarioError(f"{file} is not there; allowed: files of SUMO or OpenStreetMap")
        if bool(self.ego) == bool(self.ego_route):
            raise ScenarioError(
                "the ego of an own network has no way; allowed: either a vehicle of the routes (--ego) or "
                "edges (--ego-route)"
            )


def build_own_network(own: OwnNetwork, step_s: float, folder: Path) -> Network:
    """Convert what has to be converted, and find the ego vehicle's way.

    Raises:
        ScenarioError: SUMO is not installed or cannot read the files, the vehicle does not exist, or
            its way is not connected.
    """
    kind = folder / "ego.add.xml"
    root = ET.Element("additional")
    root.append(ego_kind())
    ET.ElementTree(root).write(kind, encoding="unicode")
    file, options, additional = own.net, ["--seed", str(own.seed)], [str(kind)]
    routes = [str(path) for path in own.routes]
    if own.net.suffix == ".sumocfg":
        file, its_routes, more = _configured(own.net)
        options += ["-c", str(own.net)]
        routes, additional = [*its_routes, *routes], [*more, *additional]
    elif own.net.suffix == ".netccfg" or ".osm" in own.net.suffixes:
        file = folder / "own.net.xml"
        is_map = own.net.suffix != ".netccfg"
        netconvert(
            ["--osm-files", str(own.net), *_OSM_OPTIONS] if is_map else ["-c", str(own.net)], file
        )
    net = SumoNet(file)
    options += ["-n", str(file), "-a", ",".join(additional)]
    options += ["-r", ",".join(routes)] if routes else []
    with closing(SumoProcess([*options, *step_options(step_s)])) as sumo:
        try:
            edges, start_s = _vehicle_way(sumo, own) if own.ego else _route_way(sumo, own)
        except sumo.failure as reason:
            raise sumo.ended(reason) from reason
    way = net.way(edges)
    start_m = min(_STARTS_AT_M, 0.5 * net.lanes[way[0].from_lane].length_m)
    road = EgoRoad.of_way(net, way, start_m)
    return Network(
        net=net,
        options=tuple(options),
        way=way,
        edges=edges,
        start_m=start_m,
        start_s=start_s + step_s,
        instead_of=own.ego,
        road=road,
        limits=road.limits(net),
    )


def _configured(file: Path) -> tuple[Path, list[str], list[str]]:
    """Return network, routes and additional files of a configuration."""
    try:
        root = ET.parse(file).getroot()  # noqa: S314  expat refuses entity bombs
    except (OSError, ET.ParseError) as reason:
        raise ScenarioError(f"{file} cannot be read as a configuration: {reason}") from reason

    def files(*names: str) -> Iterable[str]:
        for entry in root.iter():
            if entry.tag in names:
                for name in entry.get("value", "").replace(",", " ").split():
                    yield str(file.parent / name)

    net = next(iter(files("net-file", "net", "n")), None)
    if net is None:
        raise ScenarioError(f"{file} names no network; allowed: a configuration with a net-file")
    routes, more = files("route-files", "routes", "r"), files("additional-files", "additional", "a")
    return Path(net), list(routes), list(more)


def _vehicle_way(sumo: SumoProcess, own: OwnNetwork) -> tuple[tuple[str, ...], float]:
    """Return the edges of a vehicle of the routes, and SUMO's time after the step in which it departs."""
    simulation = sumo.connection.simulation
    seen: list[str] = []
    while simulation.getTime() < LONGEST_SEARCH_S:
        sumo.step()
        departed = simulation.getDepartedIDList()
        seen += departed[: _NAMES_SHOWN - len(seen)]
        if own.ego in departed:
            edges = tuple(sumo.connection.vehicle.getRoute(own.ego))
            return edges, float(simulation.getTime())
        if not simulation.getMinExpectedNumber():
            break
    raise ScenarioError(
        f"vehicle {own.ego!r} does not depart in {own.net}; allowed: vehicles of the routes, e.g. "
        f"{', '.join(seen) or 'none'}"
    )


def _route_way(sumo: SumoProcess, own: OwnNetwork) -> tuple[tuple[str, ...], float]:
    """Return the edges of the ego vehicle's route, and SUMO's time from which on it departs."""
    edges = list(own.ego_route[:1])
    for here, following in pairwise(own.ego_route):
        try:
            found = sumo.connection.simulation.findRoute(here, following, vType=EGO_KIND).edges
        except sumo.refusal as reason:
            raise ScenarioError(f"--ego-route: {reason} Allowed: edges of the network") from reason
        if not found:
            raise ScenarioError(
                f"--ego-route: no way for cars from edge {here!r} to {following!r}; allowed: connected edges"
            )
        edges += found[1:]
    return tuple(edges), own.depart_s

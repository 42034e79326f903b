"""The ego in networks of the user's own: the way through them, right of way, and mistakes in the input."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("traci", reason="requirements/traffic.txt is not installed")
pytest.importorskip("sumo", reason="requirements/traffic.txt is not installed")

from iptm_core.parameters import load_parameters
from iptm_core.program import EXIT_USER_ERROR
from iptm_traffic import cli
from iptm_traffic.demand import EGO
from iptm_traffic.drive import TrafficResult, drive_in_traffic
from iptm_traffic.network import Network
from iptm_traffic.own_network import OwnNetwork, build_own_network
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.trip import TrafficDrive

TOWN = Path(__file__).resolve().parents[3] / "docs" / "examples" / "town"
NET, ROUTES = TOWN / "town.netccfg", TOWN / "town.rou.xml"
IN_TOWN = OwnNetwork(NET, (ROUTES,), "round_trip")
PARAMETERS = load_parameters().values
STEP_S = 0.5
LIT = "main_2"
"""The edge of the ego vehicle's way that ends at the signal."""
SQUARE = ("west_in", "main_1")

MAP = """\
<osm version="0.6">
  <node id="1" lat="48.0000" lon="10.0000"/><node id="2" lat="48.0000" lon="10.0040"/>
  <node id="3" lat="48.0000" lon="10.0080"/><node id="4" lat="48.0020" lon="10.0040"/>
  <way id="10"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="secondary"/></way>
  <way id="11"><nd ref="2"/><nd ref="4"/><tag k="highway" v="residential"/></way>
</osm>
"""


def alone(folder: Path, *edges: str, vehicles: str = "") -> Network:
    """Return the town with an ego vehicle on a route and other vehicles, as SUMO's text, only."""
    file = folder / "few.rou.xml"
    file.write_text(f'<routes><vType id="car" sigma="0"/>{vehicles}</routes>', encoding="utf-8")
    return build_own_network(OwnNetwork(NET, (file,), "", edges, 0.0), STEP_S, folder)


def driven(own: OwnNetwork, duration_s: float) -> TrafficResult:
    return drive_in_traffic(TrafficDrive(duration_s=duration_s, own=own), PARAMETERS)


def test_the_ego_drives_through_the_town_and_repeats_to_the_last_bit() -> None:
    """A roundabout, crossings and a signal of variable times; the long version has the merge, too."""
    first = driven(IN_TOWN, 130.0)
    assert cli.verdict(first.world) == []
    assert first.trajectory.position_m[-1] > 910.0  # past the roundabout and the signal
    assert len(first.world.lines) == 1
    assert first.world.simulation.ego.largest_deviation_m < 1e-6
    assert driven(IN_TOWN, 130.0).digest == first.digest


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_ten_minutes_without_collision(seed: int) -> None:
    own = OwnNetwork(NET, (ROUTES,), "round_trip", seed=seed)
    first = driven(own, 600.0)
    assert cli.verdict(first.world) == []
    assert first.trajectory.position_m[-1] > 3400.0  # once round, and in it again
    assert driven(own, 600.0).digest == first.digest


def test_the_way_is_that_of_the_vehicle_with_slopes_and_bends(tmp_path: Path) -> None:
    network = build_own_network(IN_TOWN, STEP_S, tmp_path)
    road = network.road
    assert network.edges[:3] == ("main_1", "ring_1", "ring_2")
    assert network.edges.count("ring_1") == 3  # three rounds
    assert len(road.lane_starts_m["ring_1_1"]) == 3
    places = np.linspace(20.0, 420.0, 9)
    # From the square at 0 m to the roundabout at 3 m, 480 m apart.
    np.testing.assert_allclose(road.slope().slope_at(places), 3.0 / 480.0, rtol=0.1)
    entry_m, first_m = road.stop_lines_m[0], road.stop_lines_m[1]
    ring: np.ndarray = np.linspace(entry_m + 10.0, first_m, 20)
    slowest = min(network.limits.approach_at_m_s(float(place)) for place in ring)
    assert 4.0 < slowest < 8.3  # the limit of the ring is 8.3 m/s, its radius 20 m


def test_a_line_is_closed_for_who_has_priority_and_open_without(tmp_path: Path) -> None:
    """Left turn from the minor road into the square, while a car comes along the main road."""
    way = ("exit_road", "main_1", "ring_1")
    coming = '<vehicle id="a" type="car" depart="0" departPos="380"><route edges="west_in main_1"/></vehicle>'
    for vehicles, is_met in (("", False), (coming, True)):
        network = alone(tmp_path, *way, vehicles=vehicles)
        with closing(TrafficSimulation(network, None, STEP_S)) as simulation:
            rules = RightOfWay(simulation)
            line_m = network.road.stop_lines_m[0]
            # Near the line: only there the others count.
            simulation.ego.position_m = line_m - 30.0
            rules.refresh()
            line = rules.ego.next_after(line_m - 1.0)
            assert line is not None
            times = np.arange(0.0, 60.0, 0.5)
            closed = (
                [not line.is_open(time_s) for time_s in times] if line.stop_line_m == line_m else []
            )
            assert any(closed) == is_met
            if is_met:
                assert line.is_open(59.0)


@pytest.mark.parametrize("yields", [True, False])
def test_a_ego_that_yields_meets_none_of_a_row_of_cars(
    yields: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the entry of the roundabout; an ego vehicle that does not yield there collides."""
    cars = "".join(
        f'<vehicle id="a{n}" type="car" depart="{2 * n + 1.5}" departSpeed="max">'
        '<route edges="north_in ring_4 ring_1 south_out"/></vehicle>'
        for n in range(20)
    )
    routes = tmp_path / "ring.rou.xml"
    routes.write_text(f'<routes><vType id="car" sigma="0"/>{cars}</routes>', encoding="utf-8")
    if not yields:
        monkeypatch.setattr(RightOfWay, "_conflict_spans", lambda *_: [])
    own = OwnNetwork(NET, (routes,), "", ("main_1", "ring_1", "ring_2", "main_2"), 0.0)
    result = driven(own, 130.0)
    assert (cli.verdict(result.world) == []) == yields
    assert (not result.world.simulation.collisions) == yields
    assert result.trajectory.position_m[-1] > 490.0  # past the entry, at 467 m, in the end


def test_a_signal_of_variable_times_stops_and_lets_pass(tmp_path: Path) -> None:
    """Without others the signal stays as it is for long; an ego vehicle that it shows green does not stop."""
    own = OwnNetwork(NET, (), "", ("main_2", "main_3", "east_out"), 0.0)
    result = driven(own, 150.0)
    assert cli.verdict(result.world) == []
    assert len(result.world.lines) == 1
    assert result.trajectory.position_m[-1] > 600.0
    network = build_own_network(own, STEP_S, tmp_path)
    with closing(TrafficSimulation(network, None, STEP_S)) as simulation:
        rules = RightOfWay(simulation)
        lights = simulation.connection.trafficlight
        link = network.way[0]
        seen = set()
        for _ in range(160):
            simulation.step()
            rules.refresh()
            is_green = lights.getRedYellowGreenState(link.signal)[link.signal_index] in "Gg"
            line = rules.ego.next_after(0.0)
            assert line is not None
            is_closed = line.stop_line_m == network.road.stop_lines_m[0] and not line.is_open(
                simulation.time_s
            )
            assert is_closed != is_green
            seen.add(is_green)
        assert seen == {True, False}


def test_people_on_a_crossing_close_the_line(tmp_path: Path) -> None:
    file = tmp_path / "people.rou.xml"
    file.write_text(
        '<routes><person id="p" depart="0"><walk from="west_in" to="back_1"/></person></routes>',
        encoding="utf-8",
    )
    own = OwnNetwork(NET, (file,), "", ("exit_road", "main_1", "ring_1"), 0.0)
    network = build_own_network(own, STEP_S, tmp_path)
    with closing(TrafficSimulation(network, None, STEP_S)) as simulation:
        rules = RightOfWay(simulation)
        line_m = network.road.stop_lines_m[0]
        simulation.ego.position_m = line_m - 30.0
        met = set()
        for _ in range(900):
            simulation.step()
            if "p" not in simulation.connection.person.getIDList():
                break
            place = simulation.connection.person.getRoadID("p")
            rules.refresh()
            line = rules.ego.next_after(line_m - 1.0)
            assert line is not None
            is_closed = line.stop_line_m == line_m and not line.is_open(simulation.time_s)
            if place in network.net.crossings and place.startswith(":square"):
                met.add(is_closed)
            if simulation.time_s < 250.0:
                assert not is_closed  # still far from it
        assert met == {True}


def test_people_who_wait_for_green_close_the_line_before_they_walk(tmp_path: Path) -> None:
    """Their light turns green with the ego vehicle's, which then turns across their crossing."""
    net, people = tmp_path / "grid.net.xml", tmp_path / "people.rou.xml"
    command = [
        Path(sys.executable).with_name("netgenerate"),
        *(
            "--grid",
            "--grid.number",
            "3",
            "--grid.length",
            "150",
            "--sidewalks.guess",
            "--crossings.guess",
        ),
        *("--default.speed", "13.8", "--default-junction-type", "traffic_light", "-o", net),
    ]
    subprocess.run(command, check=True, capture_output=True)
    walkers = "".join(
        f'<person id="p{start_s}" depart="{start_s}" departPos="60"><walk from="A1B1" to="B1C1"/></person>'
        for start_s in range(0, 200, 5)
    )
    people.write_text(f"<routes>{walkers}</routes>", encoding="utf-8")
    own = OwnNetwork(net, (people,), "", ("A1B1", "B1B0", "B0C0"), 0.0)
    network = build_own_network(own, STEP_S, tmp_path)
    with closing(TrafficSimulation(network, None, STEP_S)) as simulation:
        rules = RightOfWay(simulation)
        link, line_m = network.way[0], network.road.stop_lines_m[0]
        simulation.ego.position_m = line_m - 30.0
        lights, persons = simulation.connection.trafficlight, simulation.connection.person
        waited = 0
        for _ in range(400):
            simulation.step()
            rules.refresh()
            state = lights.getRedYellowGreenState(link.signal)
            phases = lights.getAllProgramLogics(link.signal)[0].phases
            following = phases[(lights.getPhase(link.signal) + 1) % len(phases)].state
            switch_s = lights.getNextSwitch(link.signal) - simulation.start_s
            index = link.signal_index
            for name in persons.getIDList():
                light = network.net.crossing_lights.get(persons.getNextEdge(name))
                if light is None or light[0] != link.signal or persons.getSpeed(name) > 0.1:
                    continue
                crossing = network.net.crossing_lights[persons.getNextEdge(name)][1]
                opens = state[crossing] == "r" and following[crossing] in "Gg"
                if opens and state[index] == "r" and following[index] == "g":
                    waited += 1
                    line = rules.ego.next_after(line_m - 1.0)
                    assert line is not None
                    assert not line.is_open(switch_s + 1.0)
        assert waited


def test_a_map_of_openstreetmap_is_driven(tmp_path: Path) -> None:
    file = tmp_path / "village.osm"
    file.write_text(MAP, encoding="utf-8")
    result = driven(OwnNetwork(file, (), "", ("10#0", "10#1"), 0.0), 40.0)
    assert cli.verdict(result.world) == []
    assert result.trajectory.position_m[-1] > 200.0


def test_the_ego_halts_at_the_end_of_its_way() -> None:
    result = driven(OwnNetwork(NET, (), "", ("exit_road", "main_1"), 0.0), 130.0)
    assert cli.verdict(result.world) == []
    assert result.trajectory.speed_m_s[-1] < 0.1
    end_m = 394.0 + 10.0 + 466.0 - 6.0  # both edges and the junction between
    assert result.trajectory.position_m[-1] == pytest.approx(end_m - 7.0, abs=5.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--net", "nowhere.net.xml", "--ego", "a"], "nowhere.net.xml is not there"),
        (["--net", str(ROUTES), "--ego", "a"], "holds <routes>"),
        (["--net", __file__, "--ego", "a"], "cannot be read as a network"),
        (["--net", str(NET)], "has no way"),
        (["--net", str(NET), "--ego", "a"], "vehicle 'a' does not depart"),
        (["--net", str(NET), "--ego-route", "main_1,nowhere"], "nowhere"),
        (["--net", str(NET), "--ego-route", "east_out,main_1"], "no way for cars"),
        (["--net", str(NET), "--ego-route", "main_1"], "at least two edges"),
        (
            ["--net", str(NET), "--ego-route", "main_1,ring_1", "--prediction", "path"],
            "allowed: prediction history or signals",
        ),
        (
            ["--net", str(NET), "--ego-route", "main_1,ring_1", "--scenario", "cut_in"],
            "no scenario",
        ),
        (["--net", str(NET), "--routes", __file__, "--ego", "a"], "SUMO"),
        (["--ego", EGO], "without --net"),
    ],
)
def test_a_mistake_is_one_line(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*options, "--duration-s", "5", "--against", "none"]) == EXIT_USER_ERROR
    output = capsys.readouterr().err
    assert words in output
    assert output.count("\n") == 1

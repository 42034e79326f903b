"""The ego vehicle in SUMO: exact, repeatable, lawful. Skipped without the extra."""

from __future__ import annotations

import hashlib
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

pytest.importorskip("traci", reason="requirements/traffic.txt is not installed")
pytest.importorskip("sumo", reason="requirements/traffic.txt is not installed")

from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.state import Command
from iptm_plant_sim.plant import Plant
from iptm_traffic import cli
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    EGO,
    DemandSettings,
    TrafficScenario,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.drive import drive_in_traffic
from iptm_traffic.moved_car import EgoInstant
from iptm_traffic.network import CYCLE_S, SIGNALS, Network, build_network
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.sumo_process import SumoProcess
from iptm_traffic.trip import PredictionInput, TrafficDrive

PARAMETERS = load_parameters().values
SETTINGS = DemandSettings(traffic_seed=3)


def corridor(folder: Path) -> Network:
    offsets = signal_offsets_s(TrafficScenario.FOLLOWING, SETTINGS, CYCLE_S)
    return build_network(folder, offsets, BEFORE_TRIP_S)


def started(network: Network, folder: Path, step_s: float = 0.5) -> TrafficSimulation:
    demand = write_demand(
        TrafficScenario.FOLLOWING,
        SETTINGS,
        600.0,
        15.0,
        step_s,
        folder,
        with_stand_in=False,
    )
    return TrafficSimulation(network, demand, step_s)


def driven_at_random(network: Network, folder: Path, seconds: int, step_s: float) -> str:
    """Drive with random accelerations and many halts inside a tick; return a digest of SUMO's output."""
    draws = np.random.default_rng(5)
    plant = Plant(PARAMETERS, network.road.slope().slope_at)
    state = plant.initial_state()
    digest = hashlib.sha256()
    with closing(started(network, folder, step_s)) as simulation:
        halts = 0
        for _ in range(seconds):
            wish = 4.0 * np.sin(state.time_s / 9.0) + draws.normal(0.0, 1.0) - 0.4 * state.speed_m_s
            before = state.speed_m_s
            state = plant.advance(state, Command(float(wish), 0.0)).state
            halts += before > 0.5 and state.speed_m_s == 0.0
            here = EgoInstant(state.time_s, state.position_m, state.speed_m_s)
            simulation.move_ego(here, 1.0)
            around = simulation.neighbours()
            digest.update(
                repr((simulation.ego.sumo_position_m(), simulation.ego.leader())).encode()
            )
            digest.update(around.positions_m.tobytes())
        assert halts > seconds / 200
        assert state.position_m > 0.5 * seconds
        assert simulation.ego.largest_deviation_m < 1e-6
    return digest.hexdigest()


@pytest.mark.parametrize("step_s", [0.2, 1.0])
def test_sumo_and_plant_agree_and_repeat(step_s: float, tmp_path: Path) -> None:
    network = corridor(tmp_path)
    first = driven_at_random(network, tmp_path, 200, step_s)
    assert driven_at_random(network, tmp_path, 200, step_s) == first


def test_the_plan_is_that_of_sumos_signals(tmp_path: Path) -> None:
    network = corridor(tmp_path)
    net = ET.parse(tmp_path / "corridor.net.xml").getroot()  # noqa: S314  written just now
    links = {
        link.get("tl"): int(link.get("linkIndex", "0"))
        for link in net.iter("connection")
        if link.get("from", "").startswith("main_") and link.get("dir") == "s"
    }
    with closing(started(network, tmp_path)) as simulation:
        lights = simulation.connection.trafficlight
        opened = set()
        for _ in range(200):
            simulation.step()
            # What SUMO shows has held since the beginning of the step.
            time_s = simulation.time_s - 0.25
            for name, signal in zip(SIGNALS, network.signals, strict=True):
                is_open = lights.getRedYellowGreenState(name)[links[name]] == "G"
                assert is_open == signal.is_open(time_s), f"{name} at {time_s} s"
                opened.add((name, is_open))
        assert len(opened) == 2 * len(links)


def test_vehicles_lie_where_sumo_has_them(tmp_path: Path) -> None:
    network = corridor(tmp_path)
    with closing(started(network, tmp_path)) as simulation:
        around = simulation.neighbours()
        leader = simulation.ego.leader()
        assert leader is not None
        name, gap_m, speed_m_s = leader
        row = around.names.index(name)
        rear_m = around.positions_m[row] - around.lengths_m[row]
        assert rear_m == pytest.approx(gap_m, abs=1e-6)
        assert gap_m == pytest.approx(15.0)
        assert speed_m_s == around.speeds_m_s[row] == 0.0
        assert abs(around.lateral_m[row]) < 1e-6


@pytest.mark.parametrize(
    ("scenario", "knowledge"),
    [
        (TrafficScenario.RED_LIGHT_QUEUE, PredictionInput.SIGNALS),
        (TrafficScenario.CUT_IN, PredictionInput.PATH),
    ],
)
def test_a_drive_is_lawful_and_repeats_to_the_last_bit(
    scenario: TrafficScenario, knowledge: PredictionInput
) -> None:
    drive = TrafficDrive(scenario, knowledge, 130.0)
    first = drive_in_traffic(drive, PARAMETERS)
    assert cli.verdict(first.world) == []
    assert first.trajectory.position_m[-1] > 800.0
    told_by = "signals" if knowledge is PredictionInput.SIGNALS else "received_path"
    assert first.predictors[told_by] > 5
    assert drive_in_traffic(drive, PARAMETERS).digest == first.digest


def test_a_ego_that_learns_signals_by_radio_keeps_them() -> None:
    pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")
    given = TrafficDrive(TrafficScenario.RED_LIGHT_QUEUE, PredictionInput.SIGNALS, 230.0)
    result = drive_in_traffic(replace(given, signals_by_radio=True), PARAMETERS)
    assert cli.verdict(result.world) == []
    assert len(result.world.lines) > 0
    assert result.world.lines_passed_closed == 0
    assert result.largest_excess_m_s < 1.0  # as with the plan as data
    assert result.predictors["signals"] > 5


def test_who_leads_changes_when_the_leader_turns_off() -> None:
    drive = TrafficDrive(TrafficScenario.TURN_OFF, PredictionInput.HISTORY, 260.0)
    result = drive_in_traffic(replace(drive, step_s=1.0), PARAMETERS)
    assert cli.verdict(result.world) == []
    assert result.world.leaders[0] == "leader"
    assert len(result.world.leaders) > 1


def test_what_a_vehicle_did_becomes_a_drive(tmp_path: Path) -> None:
    """SUMO's own word on the ego vehicle is that of the plant; writing it changes nothing."""
    file = tmp_path / "traffic.fcd.xml"
    drive = TrafficDrive(TrafficScenario.FOLLOWING, PredictionInput.HISTORY, 40.0)
    result = drive_in_traffic(drive, PARAMETERS, file)
    assert drive_in_traffic(drive, PARAMETERS).digest == result.digest
    driven = result.trajectory
    route = build_route(f"{file}#{EGO}", initial_gap_m=15.0)
    np.testing.assert_allclose(route.leader.speeds_at(driven.time_s), driven.speed_m_s, atol=1e-3)
    road = corridor(tmp_path).road.slope()
    there = np.linspace(50.0, float(driven.position_m[-1]), 20)
    assert np.ptp(road.slope_at(there)) > 0.04
    # SUMO's road is a polygon, whose slope is constant between two of its points.
    np.testing.assert_allclose(route.slope.slope_at(there), road.slope_at(there), atol=8e-3)


@pytest.mark.slow
def test_an_hour_without_drift() -> None:
    drive = TrafficDrive(TrafficScenario.FOLLOWING, PredictionInput.SIGNALS, 3600.0)
    result = drive_in_traffic(drive, PARAMETERS)
    assert cli.verdict(result.world) == []
    assert result.world.simulation.ego.largest_deviation_m < 1e-6


def test_sumo_that_ends_is_one_error(tmp_path: Path) -> None:
    process = SumoProcess(["-n", str(tmp_path / "missing.net.xml")])
    with closing(process), pytest.raises(ScenarioError, match=r"missing\.net\.xml"):
        process.step()

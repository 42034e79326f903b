"""Preparation of a drive: corridor, vehicles, and a rehearsal if paths are announced."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.piecewise import cumulative_integral
from iptm_traffic.corridor import Corridor
from iptm_traffic.demand import BEFORE_TRIP_S, signal_offsets_s, write_demand
from iptm_traffic.drive import PredictionInput, TrafficDrive
from iptm_traffic.host_road import HostRoad
from iptm_traffic.network import CYCLE_S, Network, build_network
from iptm_traffic.own_network import build_own_network
from iptm_traffic.radio import Rehearsal, Rehearsed
from iptm_traffic.simulation import TrafficSimulation

_SURVEY_ACCELERATION_M_S2, _SURVEY_M_S = 1.0, 10.0


@dataclass(frozen=True, eq=False)
class PreparedTraffic:
    """Files and data prepared before the drive.

    Attributes:
        network: what is driven in.
        demand: file of the vehicles, None for those of an own network.
        rehearsal: their future motion, None if they do not announce it.
    """

    network: Network
    demand: Path | None
    rehearsal: dict[str, Rehearsed] | None


def prepare_traffic(
    drive: TrafficDrive, parameters: ModelParameters, folder: Path
) -> PreparedTraffic:
    """Make network and vehicles in a folder, and rehearse if paths are announced.

    Raises:
        IptmError: SUMO is not installed or fails.
    """
    if drive.own is not None:
        return PreparedTraffic(build_own_network(drive.own, drive.step_s, folder), None, None)
    corridor = Corridor.long_enough_for(drive.duration_s)
    offsets = signal_offsets_s(corridor, drive.scenario, drive.demand, CYCLE_S)
    network = build_network(corridor, folder, offsets, BEFORE_TRIP_S)
    rehearsal = None
    if drive.knowledge is PredictionInput.PATH:
        demand = _demand(drive, corridor, parameters, folder, with_stand_in=True)
        rehearsal = _rehearse(drive, network, demand)
    demand = _demand(drive, corridor, parameters, folder, with_stand_in=False)
    return PreparedTraffic(network, demand, rehearsal)


def _demand(
    drive: TrafficDrive,
    corridor: Corridor,
    parameters: ModelParameters,
    folder: Path,
    *,
    with_stand_in: bool,
) -> Path:
    return write_demand(
        corridor,
        drive.scenario,
        drive.demand,
        drive.duration_s,
        parameters.gap.initial_gap_m,
        drive.step_s,
        folder,
        with_stand_in=with_stand_in,
    )


def _rehearse(drive: TrafficDrive, network: Network, demand: Path) -> dict[str, Rehearsed]:
    rehearsal = Rehearsal()
    longest_s = drive.duration_s + 60.0
    with closing(TrafficSimulation(network, demand, drive.step_s, with_host=False)) as simulation:
        rehearsal.watch(simulation, longest_s)
    return rehearsal.drives(network.road)


def write_road(road: HostRoad, file: Path) -> None:
    """Write the host's way as a recorded drive along it, as anyone reads it who takes a driving cycle.

    Raises:
        ScenarioError: the file cannot be written.
    """
    drive_s = road.positions_m[-1] / _SURVEY_M_S + _SURVEY_M_S
    times = np.arange(np.ceil(drive_s))
    speeds = np.minimum(_SURVEY_ACCELERATION_M_S2 * times, _SURVEY_M_S)
    places = cumulative_integral(times, speeds)
    latitudes, longitudes, _ = road.road_line().locate(places)
    heights = np.interp(places, road.positions_m, road.heights_m)
    names = ("time_s", "latitude_deg", "longitude_deg", "elevation_m", "speed_m_s")
    table = np.column_stack([times, latitudes, longitudes, heights, speeds])
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(file, table, "%.12g", ",", header=",".join(names), comments="")
    except OSError as reason:
        raise ScenarioError(f"the road cannot be written to {file}: {reason}") from reason

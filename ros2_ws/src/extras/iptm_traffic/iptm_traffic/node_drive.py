"""The drive of ``traffic --bag``: SUMO with plant, bridge, controller and recorder over ROS 2.

A node of the traffic moves the ego vehicle in SUMO with its plant, and sends the messages of other cars.
"""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState

from iptm.trip import Trip
from iptm.trip_files import trip_text
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.program import EXIT_OK, StopRequest, refused
from iptm_core.routes.cycles import cumulative_integral
from iptm_core.routes.route import build_route
from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S
from iptm_core.units import KM_H_PER_M_S
from iptm_ros.codecs import decode_motion
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.discovery import middleware_settings, reserve_domain
from iptm_ros.process import joined_node
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic
from iptm_traffic import cli
from iptm_traffic.drive import DRIVER_FORESIGHT_S, opened_traffic
from iptm_traffic.ego_road import EgoRoad
from iptm_traffic.moved_car import EgoInstant
from iptm_traffic.network import CYCLE_S, MAIN_OPEN_S, Network
from iptm_traffic.radio import TrafficRadio
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.trip import PredictionInput, TrafficDrive
from iptm_traffic.world import SumoWorld
from iptm_v2x_bridge.datagrams import (
    NOT_ALL_SENT,
    REPEAT_PERIOD_S,
    DatagramSender,
)
from iptm_v2x_bridge.messages.cam import specification

NAME = "traffic"
_LOCALHOST = "127.0.0.1"


class TrafficNode(SuiteNode):
    """Lets SUMO pass the interval before every state of the plant, and sends the messages of that interval.

    They go through one socket with the end of the tick behind them, which is repeated until the next tick, so
    the bridge hears the same in every run. A node drives one trip, from trip time 0.

    Attributes:
        world: SUMO around the ego vehicle.
    """

    def __init__(
        self,
        context: Context,
        drive: TrafficDrive,
        parameters: ModelParameters,
        simulation: TrafficSimulation,
        radio: TrafficRadio,
        to_port: int,
    ) -> None:
        """Join the graph."""
        super().__init__(NAME, context=context)
        self.world = SumoWorld(drive.scenario, simulation, radio, parameters)
        self._datagrams = DatagramSender(_LOCALHOST, to_port)
        self._ego: EgoInstant | None = None
        specification()  # compiled now, not at the first tick, which others wait for
        self._reporter = DiagnosticsReporter.of_node(self, NAME)
        self.every(REPEAT_PERIOD_S, self._datagrams.repeat_end)
        self.every(REPORT_PERIOD_S, self._report)
        self.listen(Topic.PLANT_STATE, self._on_ego)
        self._report()

    def _on_ego(self, message: JointState) -> None:
        time_ns, position_m, speed_m_s = decode_motion(message)
        ego = EgoInstant(time_ns / NS_PER_S, position_m, speed_m_s)
        before = self._ego or EgoInstant(0.0, 0.0, 0.0)
        if not (math.isfinite(position_m) and math.isfinite(speed_m_s)):
            return  # the bridge gets no end of the tick, and reports it
        if ego.time_s < before.time_s or (self._ego is not None and ego.time_s == before.time_s):
            return  # a state that was repeated, or a new trip, which needs a new simulation
        if ego.time_s > before.time_s:
            self.world.pass_interval(before, ego)
        self._ego = ego
        for _, datagram in self.world.radio.take()[0]:
            self._datagrams.send(datagram)
        self._datagrams.end_tick(time_ns)

    def _report(self) -> None:
        ego = self._ego
        values: dict[str, object] = {
            **self._datagrams.report(),
            "leader": ("none", *self.world.leaders)[-1],
            "largest_deviation_m": self.world.simulation.ego.largest_deviation_m,
        }
        level, reason = Level.OK, "the traffic follows the plant"
        if ego is None:
            level, reason = Level.WARN, "waiting for the plant"
        elif self._datagrams.failed:
            level, reason = Level.WARN, NOT_ALL_SENT
        self._reporter.report(
            0 if ego is None else round(ego.time_s * NS_PER_S), level, reason, lambda: values
        )

    def destroy_node(self) -> None:
        """Give the socket back, too."""
        self._datagrams.close()
        super().destroy_node()


RUN = "iptm.commands.run"
_BENDS_IN_LIMITS_M_S2 = 10.0
"""Bends that matter are in the limits of the network, which the ego vehicle has without ROS, too."""
_SPIN_TIMEOUT_S = 0.1
_PATIENCE_S = 60.0
_SURVEY_ACCELERATION_M_S2, _SURVEY_M_S = 1.0, 10.0


def bridge_parameters(drive: TrafficDrive, network: Network, port: int) -> dict[str, object]:
    """Return the parameters of the bridge: its port, and the rules of the road."""
    knows_plan = drive.knowledge is PredictionInput.SIGNALS
    limits = network.limits
    rules: dict[str, object] = {
        "speed_limits_km_h": ", ".join(
            f"{start_m:.9g}:{KM_H_PER_M_S * limit:.9g}"
            for start_m, limit in zip(limits.starts_m, limits.limits_m_s, strict=True)
        )
    }
    if drive.signals_by_radio:
        rules["roadside_messages"] = True
    else:
        rules["signals"] = ", ".join(
            f"{line.stop_line_m:.17g}:{CYCLE_S:g}:{line.begins_at_s:g}:{MAIN_OPEN_S:g}"
            for line in network.signals
        )
    return rules | {
        "leader_source": "cam",
        "cam_port": port,
        "publish_datagrams": True,
        "ego_keeps_rules": True,
        "max_lateral_acceleration_m_s2": _BENDS_IN_LIMITS_M_S2,
        "leader_keeps_rules": knows_plan,
        "line_foresight_s": PreviewSettings.preview_length_s if knows_plan else DRIVER_FORESIGHT_S,
    }


def trip_of(
    drive: TrafficDrive, parameter_set: str, road: Path, bridge: Mapping[str, object]
) -> Trip:
    """Return the trip of a drive over ROS 2."""
    values = {"prediction": drive.knowledge, "step_s": drive.step_s, **asdict(drive.demand)}
    return Trip.of(
        str(road),
        name=f"traffic_{drive.scenario}",
        description=f"SUMO: {', '.join(f'{name} {value}' for name, value in values.items())}",
        parameter_set=parameter_set,
        duration_s=drive.duration_s,
        strategy=drive.strategy,
        seed=drive.demand.traffic_seed,
        # Long timeouts: a slow SUMO is not a fault.
        command_timeout_wall_s=10.0 * _PATIENCE_S,
        input_timeout_s=_PATIENCE_S,
        **bridge,
    )


def _free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def drive_over_ros(
    drive: TrafficDrive,
    parameter_set: str,
    bag: Path,
    fcd: Path | None,
    console: Console,
    stop: StopRequest,
) -> int:
    """Drive, record into the folder `bag`, write the road next to it, and report.

    Returns:
        The exit code of the run, or `cli.EXIT_NOT_GOOD` where it is 0 and a requirement is violated.

    Raises:
        IptmError: SUMO is not installed or fails, or the strategy is not known.
    """
    parameters = load_parameters(parameter_set).values
    with ExitStack() as stack:
        traffic = opened_traffic(drive, parameters, fcd)
        simulation, rehearsal = stack.enter_context(traffic)
        road = bag.absolute().with_name(f"{bag.name}_road.csv")
        write_road(simulation.network.road, road)
        line = build_route(road, initial_gap_m=parameters.gap.initial_gap_m).road_line
        radio = TrafficRadio(simulation, line, rehearsal, with_roadside=drive.signals_by_radio)
        domain, port = stack.enter_context(reserve_domain()), _free_port()
        joined = joined_node(
            lambda context: TrafficNode(context, drive, parameters, simulation, radio, port), domain
        )
        node, executor = stack.enter_context(joined)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="iptm_traffic_")))
        bridge = bridge_parameters(drive, simulation.network, port)
        trip = trip_of(drive, parameter_set, road, bridge)
        file = folder / f"{trip.name}.yaml"
        file.write_text(trip_text(trip), encoding="utf-8")
        command = [sys.executable, "-m", RUN, str(file), "--domain", str(domain)]
        command += ["--output", str(bag), "--wait-for", node.get_fully_qualified_name()]
        code = _run_during(executor, command, stop)
        if code != EXIT_OK:
            return code
        world = node.world
        table = Table("in the traffic", title=f"{drive.scenario}, {drive.knowledge} known")
        table.title_justify = "left"
        table.add_column("", justify="right")
        table.add_row("Smallest gap (m)", f"{world.smallest_gap_m:.2f}")
        for label, text in cli.traffic_rows(world).items():
            table.add_row(label, text)
        console.print(table)
        return cli.judged(world, console)


def write_road(road: EgoRoad, file: Path) -> None:
    """Write the ego's road as a recorded drive along it, the form of a driving cycle; a replay needs it.

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


def _run_during(executor: EventsExecutor, command: list[str], stop: StopRequest) -> int:
    """Run a command while a node takes part; signals reach it as well, or are passed on."""
    process = subprocess.Popen(command)  # noqa: S603
    forwarded = False
    try:
        while process.poll() is None:
            executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
            if stop.number is not None and not forwarded:
                process.send_signal(stop.number)
                forwarded = True
        return process.returncode
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def main() -> int:
    """Drive; see `iptm_traffic.cli`."""
    parsed = cli.build_parser().parse_args()
    stop = StopRequest()
    stop.install()
    os.environ.update(middleware_settings())
    console = Console(width=None if sys.stdout.isatty() else cli.TABLES_WIDTH)
    try:
        drive = cli.drive_from(parsed)
        return drive_over_ros(drive, parsed.parameter_set, parsed.bag, parsed.fcd, console, stop)
    except IptmError as error:
        return refused(cli.PROGRAM, error)


if __name__ == "__main__":
    sys.exit(main())

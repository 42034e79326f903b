"""The plant node: lock-step, real time, lost controllers, and how it ends."""

from __future__ import annotations

import math
import signal
import time
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np
import pytest
from tests.integration.driven_plant import DrivenPlant, Script, driven_plant, lively
from tests.integration.node_bench import S
from tests.plant_messages import plant_messages
from tests.table_messages import encode_leader_preview

from iptm_core.errors import IptmError
from iptm_core.parameters import load_parameters
from iptm_core.radio_lead import RadioLead
from iptm_core.routes import build_route
from iptm_core.settings import ThermalModel
from iptm_core.state import Command, FullChannelState, LeaderPreview, VehicleState
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.trip import PlantTrip
from iptm_ros.codecs import decode_observation, encode_clock, ns_from_time
from iptm_ros.diagnostics import Level
from iptm_ros.services import Service
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

pytestmark = pytest.mark.usefixtures("ros_environment")
MODULE = "iptm_plant_sim.node"
EXIT_CONTROLLER_LOST = 3
RUNNING = (Level.OK, "running")
REAL_TIME: dict[str, Any] = {"mode": "real_time", "rate_factor": 20.0, "slope": "flat"}


def always(acceleration_m_s2: float) -> Any:
    return lambda _: Command(acceleration_m_s2, 0.0)


def begin(plant: DrivenPlant) -> None:
    plant.bench.spin_until(lambda: plant.ticks)


def as_seen(step: PlantStep) -> VehicleState:
    """The state as it arrives: of all cells the first and the last one."""
    return decode_observation(plant_messages(step.state, step.powers)[Topic.PLANT_STATE]).state


@pytest.mark.parametrize("thermal_model", list(ThermalModel))
def test_lock_step_follows_the_pure_plant_bit_for_bit(thermal_model: ThermalModel) -> None:
    with driven_plant(duration_s=80.0, thermal_model=thermal_model.value) as node:
        node.drive(lively)
        assert node.ticks == [tick * S for tick in range(81)]
        assert node.bench.node.exit_code == 0
        assert node.bench.values["phase"] == "finished"
        assert node.bench.values["tick"] == "80"
        route = build_route("nycc", "large", initial_gap_m=15.0)
        plant = Plant(load_parameters().values, route.slope.slope_at, thermal_model=thermal_model)
        step = plant.observe(plant.initial_state())
        for tick in range(81):
            stamp_ns = tick * S
            assert node.state(stamp_ns) == as_seen(step), f"tick {tick}"
            observed = decode_observation(node.message(Topic.PLANT_STATE, stamp_ns))
            assert observed.powers == step.powers
            check_plots(node, stamp_ns, step)
            step = plant.advance(step.state, lively(tick))
        assert any(node.state(stamp).speed_m_s == 0.0 for stamp in node.ticks[20:])


def check_plots(node: DrivenPlant, stamp_ns: int, step: PlantStep) -> None:
    """Compare the messages that no decision depends on."""
    for topic, expected_k in (
        (Topic.PLANT_COOLANT_INLET_TEMPERATURE, step.coolant_inlet_temperature_k),
        (Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, step.coolant_outlet_temperature_k),
    ):
        found_k = node.message(topic, stamp_ns).temperature + CELSIUS_ZERO_K
        assert found_k == pytest.approx(expected_k, abs=1e-12)
    battery = node.message(Topic.PLANT_BATTERY, stamp_ns)
    assert battery.current == pytest.approx(-step.pack_current_a, rel=1e-6)
    assert battery.voltage == pytest.approx(step.pack_voltage_v, rel=1e-6)
    assert battery.cell_voltage[0] == pytest.approx(step.cell_1_voltage_v, rel=1e-6)
    assert battery.cell_voltage[-1] == pytest.approx(step.cell_n_voltage_v, rel=1e-6)
    state = step.state
    cells_k = [state.cell_1_temperature_k, state.cell_n_temperature_k]
    if isinstance(state, FullChannelState):
        cells_k = state.cells.temperatures_k.tolist()
    cells_c = [cell_k - CELSIUS_ZERO_K for cell_k in cells_k]
    assert list(battery.cell_temperature) == pytest.approx(cells_c, abs=1e-5)
    assert len(battery.cell_voltage) == len(cells_k)


def test_the_first_state_is_offered_until_a_controller_answers_it() -> None:
    with driven_plant(start_paused=False) as plant:
        bench = plant.bench
        bench.spin_until(lambda: "waiting for /controller/command" in bench.reasons())
        assert plant.ticks == []
        peers = SuiteNode("peers")
        peers.advertise(Topic.COMMAND)
        bench.spin_until(lambda: plant.ticks)
        assert bench.situation == (Level.WARN, "waiting for the first answer of a controller")
        before = len(plant.ticks)
        peers.listen(Topic.CLOCK, lambda _: None)
        bench.spin_until(lambda: len(plant.ticks) > before)  # whoever comes later gets it, too
        assert set(plant.ticks) == {0}
        plant.answer(1.0, Command(0.3, 0.0))
        assert set(plant.ticks) == {0}
        plant.answer(0.0, Command(0.3, 0.0))
        assert plant.ticks[-1] == S
        assert plant.state(S).acceleration_m_s2 == pytest.approx(0.3)
        peers.destroy_node()


def test_a_plant_that_starts_paused_publishes_nothing_before_it_is_resumed() -> None:
    with driven_plant(start_paused=True) as plant:
        bench = plant.bench
        bench.spin_until(lambda: "waiting for plant/resume" in bench.reasons())
        plant.answer(0.0, Command(0.3, 0.0))
        assert plant.ticks == []
        assert bench.call(Service.RESUME).message == "begins"
        bench.spin_until(lambda: plant.ticks)
        assert plant.ticks == [0]


def test_only_the_command_of_the_present_tick_counts() -> None:
    with driven_plant(duration_s=3.0) as plant:
        begin(plant)
        for tick in (1.0, 5.0, 1e-9):
            plant.answer(tick, Command(0.5, 0.0))
        plant.bench.spin_until(lambda: plant.bench.values["ignored_commands"] == "3")
        assert plant.ticks == [0]
        plant.answer(0, Command(0.3, 0.0))
        plant.answer(0, Command(-0.1, 0.0))
        plant.answer(1, Command(0.4, 0.0))
        accelerations = [state.acceleration_m_s2 for state in plant.states()]
        assert accelerations == [0.0, 0.3, 0.4]


def test_limits_and_nonsense_are_reported() -> None:
    answers = [Command(5.0, 0.0), Command(math.nan, 0.0), Command(0.0, 9000.0)]
    with driven_plant(duration_s=3.0) as plant:
        plant.drive(
            lambda tick: answers[tick] if tick < 3 else None,
            lambda: plant.bench.values["phase"] == "finished",
        )
        values = plant.bench.values
        assert [state.acceleration_m_s2 for state in plant.states()] == [0.0, 0.5, 0.0, 0.0]
    assert (values["limited_ticks"], values["rejected_commands"]) == ("3", "1")
    for kind in ("acceleration_bound", "jerk", "non_finite_command", "compressor_bound"):
        assert values[f"limited_{kind}"] == "1"
    assert values["last_limit"].startswith("compressor_bound, compressor_rate: ")


def test_a_lost_controller_ends_in_a_controlled_stop() -> None:
    with driven_plant(command_timeout_wall_s=0.5) as plant:
        plant.drive(lambda tick: Command(1.0, 400.0) if tick < 8 else None)
        assert plant.bench.node.exit_code == EXIT_CONTROLLER_LOST
        reasons = plant.bench.reasons()
        assert "no commands arrive: controlled stop" in reasons
        assert reasons[-1] == "finished without a controller"
        # Nothing is left out, the stop is comfortable and complete, the compressor is off.
        assert plant.ticks == [tick * S for tick in range(len(plant.ticks))]
        states = plant.states()
    assert states[8].speed_m_s > 5.0
    assert states[-1].speed_m_s == states[-1].compressor_power_w == 0.0
    accelerations = [state.acceleration_m_s2 for state in states]
    assert min(accelerations) >= -1.0
    steps = [b - a for a, b in pairwise(accelerations[:-1])]
    assert max(map(abs, steps)) <= 0.5 + 1e-12


def test_a_silent_controller_is_reported_long_before_it_is_given_up() -> None:
    with driven_plant(command_timeout_wall_s=120.0) as plant:
        silent = (Level.STALE, "no commands arrive: waiting")
        plant.drive(lambda tick: Command(0.5, 0.0) if tick < 2 else None,
                    lambda: plant.bench.situation == silent)  # fmt: skip
        plant.answer(2, Command(0.5, 0.0))
        assert plant.bench.situation == RUNNING
        assert plant.bench.values["controller_losses"] == "0"


def test_a_controller_that_is_back_before_standstill_drives_on() -> None:
    with driven_plant(command_timeout_wall_s=0.5) as plant:
        plant.drive(
            lambda tick: Command(1.0, 0.0) if tick < 12 else None,
            lambda: plant.bench.situation[0] is Level.ERROR,
        )
        plant.answer(plant.ticks[-1] / S, Command(0.5, 0.0))
        assert plant.bench.situation == RUNNING
        assert plant.bench.values["controller_losses"] == "1"
        driven_ns = plant.ticks[-1]
        plant.answer(driven_ns / S, Command(0.5, 0.0))
        assert plant.ticks[-1] == driven_ns + S


def test_a_controller_under_the_debugger_is_waited_for() -> None:
    """Its state is repeated until it is answered, and commands that do not fit are reported."""
    with driven_plant(command_timeout_wall_s=0.2, on_lost_controller="wait") as plant:
        silent = (Level.STALE, "no commands arrive: waiting")
        plant.drive(lambda tick: Command(0.5, 0.0) if tick < 2 else None,
                    lambda: plant.bench.situation == silent)  # fmt: skip
        plant.answer(17, Command(0.5, 0.0))
        plant.bench.spin_until(lambda: "stamps answer no state" in plant.bench.situation[1])
        plant.bench.spin_until(lambda: plant.ticks.count(2 * S) >= 3)
        for received in (Topic.PLANT_STATE, Topic.PLANT_ODOMETRY):
            repeated = plant.bench.received[received][2:]
            assert all(str(each) == str(repeated[0]) for each in repeated)
        plant.answer(2, Command(0.5, 0.0))
        assert plant.bench.situation == RUNNING
        assert plant.ticks[-1] == 3 * S


def test_a_frozen_plant_reads_what_waits_before_it_judges() -> None:
    """A stopped process receives nothing; that does not count as silence of the others."""
    with driven_plant(command_timeout_wall_s=1.0) as plant:
        begin(plant)
        plant.answer(0, Command(0.3, 0.0))
        time.sleep(2.0)  # the process is stopped
        for _ in range(20):
            plant.bench._executor.spin_once(timeout_sec=0.0)
        plant.answer(1, Command(0.3, 0.0))
        assert plant.bench.situation == RUNNING
        assert plant.ticks[-1] == 2 * S


def test_a_second_controller_is_reported_when_both_answer() -> None:
    with driven_plant(command_timeout_wall_s=60.0) as plant:
        begin(plant)
        both = [SuiteNode(name) for name in ("first", "second")]
        for node in both:
            node.advertise(Topic.COMMAND)
        plant.bench.spin_until(lambda: plant.bench.node.count_publishers(Topic.COMMAND.value) == 2)

        def is_reported() -> bool:
            tick = plant.ticks[-1] / S
            for _ in range(2):
                plant.answer(tick, Command(0.3, 0.0))
            reported = (Level.ERROR, "more than one controller on this graph")
            return plant.bench.situation == reported

        plant.bench.spin_until(is_reported)
        for node in both:
            node.destroy_node()
        plant.bench.spin_until(lambda: plant.bench.situation[0] is not Level.ERROR)


def test_a_model_that_fails_ends_the_trip_as_a_defect() -> None:
    with driven_plant() as plant:
        begin(plant)
        with mock.patch.object(PlantTrip, "advance", side_effect=IptmError("no next state")):
            plant.answer(0, Command(0.3, 0.0))
        assert plant.bench.situation == (Level.ERROR, "the vehicle model failed")
        plant.bench.spin_until(plant.bench.node.ended.done)
        assert plant.bench.node.exit_code == 1


def test_real_time_stops_without_answers_and_recovers() -> None:
    with driven_plant(**REAL_TIME) as plant:

        def newest() -> VehicleState:
            return plant.state(plant.ticks[-1])

        plant.drive(always(0.5), lambda: plant.ticks and newest().speed_m_s > 3.0)
        stopping = (Level.ERROR, "no commands arrive: controlled stop")
        plant.bench.spin_until(lambda: plant.bench.situation == stopping)
        plant.bench.spin_until(lambda: newest().acceleration_m_s2 < -0.2)
        plant.drive(always(0.5), lambda: plant.bench.situation == RUNNING)
        plant.drive(always(0.5), lambda: newest().acceleration_m_s2 >= 0.5)
        # Time advanced throughout, and the actuators kept their limits under every controller.
        assert plant.ticks == [tick * S for tick in range(len(plant.ticks))]
        states = plant.states()
    for before, after in pairwise(states):
        change = abs(after.acceleration_m_s2 - before.acceleration_m_s2)
        assert change <= 0.5 + 1e-12 or after.speed_m_s == 0.0


@pytest.mark.parametrize(
    ("script", "exit_code"), [(always(0.5), 0), (lambda _: None, EXIT_CONTROLLER_LOST)]
)
def test_real_time_trip_ends_by_itself_with_or_without_a_controller(
    script: Script, exit_code: int
) -> None:
    with driven_plant(**REAL_TIME, duration_s=10.0) as plant:
        plant.drive(script)
        assert plant.bench.node.exit_code == exit_code
        assert plant.ticks == [tick * S for tick in range(11)]
        assert {"overruns", "worst_lateness_s", "command_age_s"} <= plant.bench.values.keys()


def test_in_real_time_the_vehicle_ahead_is_waited_for_and_not_for_ever() -> None:
    with driven_plant(**REAL_TIME, vehicle_ahead="/car_1") as plant:
        clock = SuiteNode("plant", namespace="car_1").advertise(Topic.CLOCK)
        for tick in range(4):
            clock.publish(encode_clock(tick * S))
        plant.bench.spin_until(lambda: 3 * S in plant.ticks)
        reached_s = time.monotonic()
        plant.bench.spin_until(lambda: 4 * S in plant.ticks)
        assert time.monotonic() - reached_s > 0.5  # ten ticks
        assert plant.ticks == [tick * S for tick in range(5)]


def test_shorter_period() -> None:
    with driven_plant(duration_s=1.0, period_s=0.1) as plant:
        begin(plant)
        while plant.ticks[-1] < S:
            plant.answer(plant.ticks[-1] / S, Command(0.2, 0.0))
        assert plant.ticks == [tick * S // 10 for tick in range(11)]
        assert plant.state(S).acceleration_m_s2 == pytest.approx(0.2)


def test_a_resumed_plant_needs_nobody_in_real_time_and_a_second_one_is_reported(
    launcher: Any, peer: Any
) -> None:
    """At once, not only when a killed process would have left the graph; both stop on a signal."""
    names = ("plant", "other")
    heard = {name: peer.statuses(f"/{name}") for name in names}
    ticks: list[int] = []
    peer.node.listen(Topic.CLOCK, lambda message: ticks.append(ns_from_time(message.clock)))
    alone = {"mode": "real_time"}
    plants = [
        launcher.start_node(MODULE, "-r", f"__node:={name}", parameters=alone) for name in names
    ]
    for name in names:
        peer.call(f"/{name}/resume")
    for name in names:
        peer.wait_until(
            lambda name=name: any(
                status.message == "more than one plant on this graph" for status in heard[name]
            ),
            what=f"the report of {name}",
        )
    peer.wait_until(lambda: S in ticks, what="a tick")
    for plant, number in zip(plants, (signal.SIGINT, signal.SIGTERM), strict=True):
        assert plant.stop(number) == 0


def test_previews_reach_the_safety_monitor_and_published_friction_does_not() -> None:
    with driven_plant(safety_monitor=True) as plant:
        plant.drive(
            lambda tick: Command(0.5, 0.0) if tick < 2 else None, lambda: len(plant.ticks) > 2
        )
        vehicle = plant.bench.node._trip.plant  # type: ignore[attr-defined]
        times_s = np.array([2.0, 3.0])
        preview = LeaderPreview(times_s, np.array([30.0, 34.0]), np.array([4.0, 4.0]))
        plant.bench.hear({Topic.LEADER_PREVIEW: encode_leader_preview(preview, 2 * S)})
        plant.answer(2, Command(0.5, 0.0))
        assert RadioLead.of(vehicle._heard, 2.0) == RadioLead(2.0, 30.0, 4.0)
        # It would brake for a message at once; the controller opens the distance in comfort.
        assert Topic.ROAD_FRICTION not in plant.bench._takers

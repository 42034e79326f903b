"""The plant as a process of its own: lock-step, real time, lost controllers, and how it ends."""

from __future__ import annotations

import math
import signal
from itertools import pairwise
from typing import Any

import pytest
from tests.integration.plant_driver import OTHER_TOPICS, Driver, S, lively, start

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.routes import build_route
from iptm_core.settings import ThermalModel
from iptm_core.state import Command, FullChannelState, VehicleState
from iptm_interfaces.codecs import (
    decode_powers,
    decode_temperature,
    decode_vehicle_state,
    encode_acceleration,
    encode_capacity_loss,
    encode_host_odometry,
    encode_powers,
    encode_temperature,
    ns_from_time,
)
from iptm_interfaces.topics import Topic
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep

EXIT_CONTROLLER_LOST = 3


def as_seen(step: PlantStep) -> VehicleState:
    """The state as it arrives: temperatures travel in degrees Celsius."""
    state = step.state
    return decode_vehicle_state(
        {
            Topic.PLANT_ODOMETRY: encode_host_odometry(state),
            Topic.PLANT_ACCELERATION: encode_acceleration(state),
            Topic.PLANT_CELL_1_TEMPERATURE: encode_temperature(
                state.time_s, state.cell_1_temperature_k
            ),
            Topic.PLANT_CELL_N_TEMPERATURE: encode_temperature(
                state.time_s, state.cell_n_temperature_k
            ),
            Topic.PLANT_POWERS: encode_powers(state.time_s, step.powers),
            Topic.PLANT_CAPACITY_LOSS: encode_capacity_loss(state),
        }
    )


@pytest.mark.parametrize("thermal_model", list(ThermalModel))
def test_lock_step_follows_the_pure_plant_bit_for_bit(
    launcher: Any, peer: Any, thermal_model: ThermalModel
) -> None:
    driver = Driver(peer, lively)
    process = start(launcher, duration_s=80.0, thermal_model=thermal_model.value)
    driver.wait(lambda: driver.has_all(80 * S), "the final state")
    assert driver.ticks == [tick * S for tick in range(81)]

    parameters = load_parameters().values
    route = build_route("nycc", "large", initial_gap_m=15.0)
    plant = Plant(parameters, route.slope.slope_at, thermal_model=thermal_model)
    step = plant.observe(plant.initial_state())
    for tick in range(81):
        stamp_ns = tick * S
        assert driver.state(stamp_ns) == as_seen(step), f"tick {tick}"
        assert decode_powers(driver.messages[Topic.PLANT_POWERS][stamp_ns]) == step.powers
        check_plots(driver, stamp_ns, step)
        step = plant.advance(step.state, lively(tick))
    assert any(driver.state(stamp).speed_m_s == 0.0 for stamp in driver.ticks[20:])

    assert driver.end(process) == 0
    assert driver.phases()[-1] == "finished"
    assert driver.values()["tick"] == "80"
    assert "Traceback" not in process.stderr


def check_plots(driver: Driver, stamp_ns: int, step: PlantStep) -> None:
    """Compare the messages that no decision depends on; the first ones may precede their listener."""
    if not all(stamp_ns in driver.messages[topic] for topic in OTHER_TOPICS):
        assert stamp_ns < 10 * S
        return
    inlet = driver.messages[Topic.PLANT_COOLANT_INLET_TEMPERATURE][stamp_ns]
    inlet_k = decode_temperature(Topic.PLANT_COOLANT_INLET_TEMPERATURE, inlet)
    assert inlet_k == pytest.approx(step.coolant_inlet_temperature_k, abs=1e-12)
    outlet = driver.messages[Topic.PLANT_COOLANT_OUTLET_TEMPERATURE][stamp_ns]
    outlet_k = decode_temperature(Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, outlet)
    assert outlet_k == pytest.approx(step.coolant_outlet_temperature_k, abs=1e-12)
    battery = driver.messages[Topic.PLANT_BATTERY][stamp_ns]
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


def test_waits_for_the_peers_and_says_for_whom(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda _: None)
    start(launcher, expected_peers=2)
    driver.wait(
        lambda: "waiting for peers on /plant/odometry, /clock" in driver.reasons(),
        "the wait reported",
    )
    assert driver.ticks == []
    for topic in (Topic.PLANT_ODOMETRY, Topic.CLOCK):
        peer.node.listen(topic, lambda _: None)
    driver.wait(lambda: driver.has_all(0), "the first state")
    assert driver.state(0).speed_m_s == 0.0


def test_only_the_command_of_the_present_tick_counts(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda _: None)
    process = start(launcher, duration_s=3.0)
    driver.wait(lambda: driver.has_all(0), "the first state")
    for stamp_ns in (S, 5 * S, 1):
        driver.send(stamp_ns, Command(0.5, 0.0))
    driver.wait(lambda: driver.values().get("ignored_commands") == "3", "three commands ignored")
    assert driver.ticks == [0]
    driver.send(0, Command(0.3, 0.0))
    driver.wait(lambda: driver.has_all(S), "the state after the right one")
    assert driver.state(S).acceleration_m_s2 == 0.3
    driver.send(0, Command(-0.1, 0.0))
    driver.send(S, Command(0.4, 0.0))
    driver.wait(lambda: driver.has_all(2 * S), "the next state")
    assert driver.state(2 * S).acceleration_m_s2 == 0.4
    driver.send(2 * S, Command(0.4, 0.0))
    assert driver.end(process) == 0


def test_limits_and_nonsense_are_reported(launcher: Any, peer: Any) -> None:
    answers = [Command(5.0, 0.0), Command(math.nan, 0.0), Command(0.0, 9000.0)]
    driver = Driver(peer, lambda tick: answers[tick] if tick < 3 else None)
    process = start(launcher, duration_s=3.0)
    driver.wait(lambda: driver.has_all(3 * S), "the final state")
    assert driver.end(process) == 0
    values = driver.values()
    assert values["limited_ticks"] == "3"
    assert values["rejected_commands"] == "1"
    assert values["limited_acceleration_bound"] == "1"
    assert values["limited_jerk"] == "1"
    assert values["limited_non_finite_command"] == "1"
    assert values["limited_compressor_bound"] == "1"
    assert values["last_limit"].startswith("compressor_bound, compressor_rate: ")
    assert [driver.state(tick * S).acceleration_m_s2 for tick in range(4)] == [0.0, 0.5, 0.0, 0.0]


def test_lost_controller_ends_in_a_controlled_stop(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda tick: Command(1.0, 400.0) if tick < 8 else None)
    process = start(launcher, command_timeout_wall_s=0.5)
    assert driver.end(process) == EXIT_CONTROLLER_LOST
    assert "stopping" in driver.phases()
    assert driver.phases()[-1] == "finished"
    assert driver.reasons()[-1] == "finished without a controller"
    # Nothing is left out, the stop is comfortable and complete, the compressor is off.
    assert driver.ticks == [tick * S for tick in range(len(driver.ticks))]
    states = [driver.state(stamp) for stamp in driver.ticks]
    assert states[8].speed_m_s > 5.0
    assert states[-1].speed_m_s == 0.0
    assert states[-1].compressor_power_w == 0.0
    accelerations = [state.acceleration_m_s2 for state in states]
    assert min(accelerations) >= -1.0
    steps = [b - a for a, b in pairwise(accelerations[:-1])]
    assert max(map(abs, steps)) <= 0.5 + 1e-12


def test_a_controller_under_the_debugger_is_waited_for(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda tick: Command(0.5, 0.0) if tick != 2 else None)
    process = start(launcher, duration_s=4.0, command_timeout_wall_s=0.2, on_lost_controller="wait")
    driver.wait(lambda: "no commands arrive: waiting" in driver.reasons(), "the silence reported")
    assert driver.ticks[-1] == 2 * S
    driver.send(2 * S, Command(0.5, 0.0))
    driver.wait(lambda: driver.has_all(4 * S), "the final state")
    assert driver.end(process) == 0


def test_real_time_stops_without_answers_and_recovers(launcher: Any, peer: Any) -> None:
    speaking = True
    driver = Driver(peer, lambda _: Command(0.5, 0.0) if speaking else None)
    process = start(launcher, mode="real_time", rate_factor=20.0, slope="flat")

    def latest() -> VehicleState | None:
        complete = [stamp for stamp in driver.ticks if driver.has_all(stamp)]
        return driver.state(complete[-1]) if complete else None

    def moves(faster_than: float = 0.0, accelerating: float = -1.0) -> bool:
        state = latest()
        return (
            state is not None
            and state.speed_m_s > faster_than
            and state.acceleration_m_s2 >= accelerating
        )

    driver.wait(lambda: moves(3.0), "a moving vehicle")
    speaking = False
    driver.wait(lambda: driver.phases()[-1:] == ["stopping"], "the controlled stop")
    stopped = driver.reasons()[-1]
    driver.wait(lambda: not moves(accelerating=-0.2), "the vehicle slowing down")
    speaking = True
    driver.wait(lambda: driver.phases()[-1:] == ["running"], "the end of the stop")
    driver.wait(lambda: moves(1.0, 0.5), "the vehicle speeding up again")
    assert stopped == "no commands arrive: controlled stop"
    assert process.stop(signal.SIGINT) == 0
    # Time advanced throughout, and the actuators kept their limits under every controller.
    assert driver.ticks == [tick * S for tick in range(len(driver.ticks))]
    states = [driver.state(stamp) for stamp in driver.ticks if driver.has_all(stamp)]
    for before, after in pairwise(states):
        change = abs(after.acceleration_m_s2 - before.acceleration_m_s2)
        assert change <= 0.5 + 1e-12 or after.speed_m_s == 0.0


def test_real_time_trip_ends_by_itself(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda _: Command(0.5, 0.0))
    process = start(
        launcher, mode="real_time", rate_factor=20.0, duration_s=10.0, command_timeout_s=60.0
    )
    assert driver.end(process) == 0
    assert driver.ticks == [tick * S for tick in range(11)]
    assert {"overruns", "worst_lateness_s", "command_age_s"} <= driver.values().keys()


def test_real_time_without_any_peer_just_runs(launcher: Any, peer: Any) -> None:
    ticks: list[int] = []
    peer.node.listen(Topic.CLOCK, lambda message: ticks.append(ns_from_time(message.clock)))
    process = start(
        launcher, mode="real_time", rate_factor=50.0, duration_s=200.0, expected_peers=0
    )
    peer.wait_until(lambda: ticks and ticks[-1] == 200 * S, what="the last tick")
    assert process.wait() == EXIT_CONTROLLER_LOST


def test_two_plants_in_real_time_both_report_it(launcher: Any, peer: Any) -> None:
    """At once, not only when a killed process would have left the graph."""
    names = ("plant", "other")
    heard = {name: peer.statuses(f"/{name}") for name in names}
    alone = {"mode": "real_time", "expected_peers": 0}
    for name in names:
        launcher.start_node("iptm_plant_sim.node", "-r", f"__node:={name}", parameters=alone)
    for name in names:
        peer.wait_until(
            lambda name=name: any(
                status.message == "more than one plant on this graph" for status in heard[name]
            ),
            20.0,
            f"the report of {name}",
        )


def test_shorter_period(launcher: Any, peer: Any) -> None:
    driver = Driver(peer, lambda _: Command(0.2, 0.0))
    process = start(launcher, duration_s=1.0, period_s=0.1)
    driver.wait(lambda: driver.has_all(S), "the final state")
    assert driver.end(process) == 0
    assert driver.ticks == [tick * S // 10 for tick in range(11)]
    assert driver.state(S).acceleration_m_s2 == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("mode", "number"), [("lock_step", signal.SIGINT), ("real_time", signal.SIGTERM)]
)
def test_stops_cleanly_on_signals(
    launcher: Any, peer: Any, mode: str, number: signal.Signals
) -> None:
    driver = Driver(peer, lively)
    process = start(launcher, mode=mode, rate_factor=20.0)
    driver.wait(lambda: len(driver.ticks) > 3, "a running plant")
    assert process.stop(number) == 0

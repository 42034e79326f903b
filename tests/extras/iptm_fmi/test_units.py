"""Plant, meter and controller as FMUs against the suite, driven by FMPy, and what they refuse."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.extras.iptm_fmi.drives import STATES, Recorded, closed, recorded
from tests.extras.iptm_fmi.master import Instance

from iptm_controller.ladder import thermostat_power_w
from iptm_core.frozen import replace
from iptm_core.parameters import load_parameters
from iptm_core.state import Command
from iptm_fmi.fmu_file import write_fmus
from iptm_fmi.plant_unit import plant_unit
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.plant import Plant

VERSIONS = (2, 3)
CYCLES = ("nycc", "sc03", "us06", "hwfet", "udds", "wltc_class3b")
ENERGIES = {
    "traction_energy": "traction_power_w",
    "battery_energy": "battery_power_w",
    "chiller_heat": "chiller_heat_w",
    "battery_heat": "battery_heat_w",
}


def drive(path: Path, trip: Recorded) -> None:
    """Drive a plant with recorded commands, and compare states, energies and terminals at every tick."""
    sums = np.zeros(len(ENERGIES))
    with Instance(path) as plant:
        position_m = 0.0
        for tick, (command, step) in enumerate(zip(trip.commands, trip.steps, strict=True)):
            plant.put(
                acceleration_command=command.acceleration_m_s2,
                compressor_power_command=command.compressor_power_w,
                **trip.road(position_m),
            )
            plant.step(float(tick))
            found = plant.get(*STATES)
            position_m = found[0]
            expected = [getattr(step.state, name) for name in STATES.values()]
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-12), tick
            sums += [getattr(step.powers, name) for name in ENERGIES.values()]
            terminals = plant.get("pack_current", "pack_voltage", "coolant_inlet")
            own = step.pack_current_a, step.pack_voltage_v, step.coolant_inlet_temperature_k
            assert terminals == pytest.approx(own, rel=1e-9)
        assert plant.get(*ENERGIES) == pytest.approx(sums, rel=1e-9)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_plant_drives_as_in_the_suite(made: Path, version: int) -> None:
    drive(made / f"plant_{version}.fmu", recorded("nycc", slope="large", duration_s=300.0))


def test_a_pack_with_limits_is_limited_as_in_the_suite(tmp_path: Path) -> None:
    """On a steep road the pack takes less than the motor would feed back."""
    write_fmus({3: tmp_path / "i3.fmu"}, plant_unit(load_parameters("bmw_i3").values))
    drive(tmp_path / "i3.fmu", recorded("us06", "bmw_i3", slope="large", duration_s=200.0))


@pytest.mark.slow
@pytest.mark.parametrize("slope", ["small", "large"])
@pytest.mark.parametrize("cycle", CYCLES)
def test_the_plant_drives_as_in_the_suite_on_twelve_roads(
    made: Path, cycle: str, slope: str
) -> None:
    drive(made / "plant_2.fmu", recorded(cycle, slope=slope))


@pytest.mark.parametrize("version", VERSIONS)
def test_the_meter_follows_a_speed(made: Path, version: int) -> None:
    """As the plant of the suite at the acceleration between two speeds, cooled by its thermostat."""
    parameters = load_parameters("paper_calibrated").values
    plant = Plant(parameters, lambda positions: 0.02 + 0.0 * positions)
    state = plant.initial_state()
    speeds = [0.0, 1.5, 3.5, 3.5, 2.0, 0.4, 0.0, 0.0, 5.0]
    with Instance(made / f"meter_{version}.fmu", {"cell_1_temperature": 311.0}) as meter:
        state = plant.initial_state()
        state = replace(state, cell_1_temperature_k=311.0)
        used_j = 0.0
        for second, speed in enumerate(speeds):
            meter.put(speed_measured=speed, slope=0.02)
            meter.step(float(second))
            command = Command(speed - state.speed_m_s, thermostat_power_w(state, parameters))
            step = plant._drive_interval(state, ActuatorReport(command, command), 1.0)
            state = step.state
            used_j += step.powers.battery_power_w
            found = meter.get("speed", "cell_1_temperature", "cell_n_capacity_loss")
            own = state.speed_m_s, state.cell_1_temperature_k, state.cell_n_capacity_loss
            assert found == pytest.approx(own, rel=1e-12)
        assert meter.get("battery_energy") == pytest.approx([used_j], rel=1e-12)


@pytest.mark.parametrize("version", VERSIONS)
def test_controller_and_plant_closed_by_another_master(controllers: Path, version: int) -> None:
    trip = recorded("us06", slope="large", duration_s=200.0, value_beyond_trip=True)
    energy_j, loss, others = closed(controllers, version, trip)
    assert others == 0
    assert energy_j == pytest.approx(sum(s.powers.battery_power_w for s in trip.steps), rel=1e-9)
    start = trip.parameters.aging.initial_capacity_loss
    expected = trip.steps[-1].state.cell_n_capacity_loss - start
    assert loss - start == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("slope", ["flat", "small", "large"])
@pytest.mark.parametrize("cycle", CYCLES)
def test_controller_and_plant_closed_on_whole_cycles(
    controllers: Path, cycle: str, slope: str
) -> None:
    trip = recorded(cycle, slope=slope, value_beyond_trip=True)
    energy_j, loss, _ = closed(controllers, 2, trip)
    used_j = sum(s.powers.battery_power_w for s in trip.steps)
    assert energy_j == pytest.approx(used_j, rel=1e-9)
    assert loss == pytest.approx(trip.steps[-1].state.cell_n_capacity_loss, rel=1e-9)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_state_is_taken_up_again(made: Path, version: int) -> None:
    with Instance(made / f"plant_{version}.fmu") as plant:
        unit = plant.unit
        get, put = (
            (unit.getFMUState, unit.setFMUState)
            if version == 3
            else (unit.getFMUstate, unit.setFMUstate)
        )
        plant.put(acceleration_command=1.0, compressor_power_command=500.0)
        plant.step(0.0)
        kept = get()
        as_bytes = unit.serializeFMUState(kept) if version == 3 else unit.serializeFMUstate(kept)
        plant.step(1.0)
        first = plant.get(*STATES)
        put(kept)
        plant.step(1.0)
        assert plant.get(*STATES) == first
        again = (
            unit.deserializeFMUState(as_bytes)
            if version == 3
            else unit.deSerializeFMUstate(as_bytes)
        )
        put(again)
        plant.step(1.0)
        assert plant.get(*STATES) == first


def test_a_hundred_instances_have_the_same_bits(made: Path) -> None:
    """All are of one library, which has no memory of its own."""
    instances = [Instance(made / "plant_2.fmu") for _ in range(100)]
    for tick in range(3):
        for plant in instances:
            plant.put(acceleration_command=0.1 * tick)
            plant.step(float(tick))
    assert len({tuple(plant.get(*STATES, "battery_energy")) for plant in instances}) == 1
    for plant in instances:
        plant.__exit__()


REFUSED: dict[str, Any] = {
    "not a number": lambda plant: plant.put(acceleration_command=math.nan),
    "infinite": lambda plant: plant.put(slope=math.inf),
    "out of range": lambda plant: plant.put(slope=1.0),
    "an output": lambda plant: plant.put(battery_energy=1.0),
    "a start after the start": lambda plant: plant.put(cell_1_temperature=300.0),
    "a step of 0": lambda plant: plant.step(0.0, 0.0),
    "a step backwards": lambda plant: plant.step(0.0, -1.0),
    "from another time": lambda plant: plant.step(5.0),
    "too long": lambda plant: plant.step(0.0, 1000.0),
    "not a length": lambda plant: plant.step(0.0, math.nan),
    "an unknown reference": lambda plant: plant.places.update(speed=[10_000]) or plant.get("speed"),
    "a road that goes back": lambda plant: (
        plant.put(road_nodes=2.0, road_position=[5.0, 1.0]),
        plant.step(0.0),
    ),
}


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("what", REFUSED)
def test_what_is_refused_changes_nothing(made: Path, version: int, what: str) -> None:
    with (
        Instance(made / f"plant_{version}.fmu") as plant,
        Instance(made / f"plant_{version}.fmu") as other,
    ):
        with pytest.raises(Exception, match=r"(?i)discard|error|status"):
            REFUSED[what](plant)
        plant.put(road_nodes=0.0)
        for one in (plant, other):
            one.places = other.places
            one.put(acceleration_command=0.5)
            one.step(0.0)
        assert plant.get(*STATES) == other.get(*STATES)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_pack_that_cannot_deliver_discards_the_step(made: Path, version: int) -> None:
    starts = {"state_of_charge": 1e-9, "speed": 20.0}
    with Instance(made / f"plant_{version}.fmu", starts) as plant:
        before = plant.get(*STATES)
        plant.put(acceleration_command=1.0)
        with pytest.raises(Exception, match=r"(?i)discard|status"):
            plant.step(0.0)
        assert plant.get(*STATES) == before


@pytest.mark.parametrize("version", VERSIONS)
def test_another_token_makes_no_instance(made: Path, version: int) -> None:
    with pytest.raises(Exception, match=r"(?i)instantiate"):
        Instance(made / f"plant_{version}.fmu", None, 0.0, "{of another file}")


def test_a_step_that_is_no_tick_holds_the_command(controllers: Path) -> None:
    with Instance(controllers / "controller_2.fmu") as controller:
        controller.put(position=0.0, speed=10.0, leader_position=60.0, leader_speed=10.0)
        held, times = [], np.arange(0.0, 2.0, 0.25)
        for time_s in times:
            controller.put(speed=10.0)
            controller.step(float(time_s), 0.25)
            held.append(controller.get("held", "acceleration_command"))
        assert [row[0] for row in held] == [0.0, 1.0, 1.0, 1.0] * 2
        assert len({row[1] for row in held[:4]}) == 1
        controller.step(2.0, 3.0)
        assert controller.get("held", "missed_ticks") == [0.0, 2.0]


def test_previews_and_roads_have_room(controllers: Path) -> None:
    with Instance(controllers / "controller_3.fmu") as controller:
        with pytest.raises(Exception, match=r"(?i)discard|status"):
            controller.put(preview_nodes=65.0)
        controller.put(preview_nodes=2.0, preview_time=[1.0, 1.0])
        with pytest.raises(Exception, match=r"(?i)discard|status"):
            controller.step(0.0)

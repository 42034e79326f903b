"""Sensors and cooling of the pack that lie, one and both: what counts instead, and what is said."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm_controller.measurements import Measurements
from iptm_controller.pack_observer import PackFault, PackObserver, PackObserverInC, PackReport
from iptm_controller.tick_library import tick_library
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, LeaderPreview, SlopePreview, VehicleState
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

VALUES = load_parameters(
    overrides={"environment.initial_cell_temperature_k": 36.0 + CELSIUS_ZERO_K}
).values
FLAT = SlopePreview(np.array([0.0]), np.array([0.0]))
FAULT_S = 30.0
Lie = Callable[[VehicleState], VehicleState]


def measured(state: VehicleState, step: PlantStep, *, coolant: bool = True) -> Measurements:
    reading = step.pack_reading if coolant else None
    return Measurements(state, None, LeaderPreview.empty(), FLAT, pack=reading)


def drive(
    lie: Lie,
    seconds: int = 200,
    *,
    coolant: bool = True,
    fault_s: float = FAULT_S,
    compressor_w: float = 1200.0,
    dead: bool = False,
) -> list[tuple[PackReport, VehicleState]]:
    """Drive in waves; a dead compressor echoes its command. C reports as Python does, to the last bit."""
    plant, observer = Plant(VALUES, np.zeros_like), PackObserver(VALUES)
    in_c = PackObserverInC(VALUES, tick_library())
    step = plant.observe(plant.initial_state(speed_m_s=20.0))
    command, found = Command(0.0, 0.0), []
    for tick in range(seconds):
        state = step.state
        shown = replace(state, compressor_power_w=command.compressor_power_w) if dead else state
        shown = lie(shown) if state.time_s >= fault_s else shown
        scene = measured(shown, step, coolant=coolant)
        report = observer.observe(scene, command if tick else None)
        assert repr(in_c.observe(scene, command if tick else None)) == repr(report)
        assert repr(in_c.memory) == repr(observer.memory)
        found.append((report, state))
        asked_w = min(command.compressor_power_w + 200.0, compressor_w)
        command = Command(1.5 * math.sin(tick / 5.0), asked_w)
        step = plant.advance(state, replace(command, compressor_power_w=0.0) if dead else command)
    return found


def errors_k(found: list[tuple[PackReport, VehicleState]], name: str) -> list[float]:
    return [
        getattr(report.state, name) - getattr(state, name)
        for report, state in found
        if state.time_s >= FAULT_S
    ]


def first_s(found: list[tuple[PackReport, VehicleState]], fault: PackFault) -> float:
    """Seconds from the beginning of the fault to its first report."""
    return next(state.time_s for report, state in found if fault in report.faults) - FAULT_S


@pytest.mark.parametrize("coolant", [True, False])
def test_a_sound_pack_passes_unchanged(coolant: bool) -> None:
    for report, state in drive(lambda state: state, coolant=coolant):
        assert report.state is state or report.state == state
        assert (report.faults, report.reason, report.power_share) == ((), "", 1.0)


LIES: dict[str, Lie] = {
    "open": lambda state: replace(state, cell_n_temperature_k=233.15),
    "short": lambda state: replace(state, cell_n_temperature_k=398.15),
    "silent": lambda state: replace(state, cell_n_temperature_k=math.nan),
    "cold": lambda s: replace(s, cell_n_temperature_k=s.cell_n_temperature_k - 10.0),
    "warm": lambda s: replace(s, cell_n_temperature_k=s.cell_n_temperature_k + 10.0),
}


@pytest.mark.parametrize("coolant", [True, False])
@pytest.mark.parametrize("lie", LIES.values(), ids=LIES.keys())
def test_one_bad_sensor_is_replaced_with_a_margin(lie: Lie, coolant: bool) -> None:
    found = drive(lie, coolant=coolant)
    assert first_s(found, PackFault.ONE_SENSOR) <= 10.0
    assert all(-0.5 < error < 2.0 for error in errors_k(found, "cell_n_temperature_k"))
    assert all(error == 0.0 for error in errors_k(found, "cell_1_temperature_k"))
    assert found[-1][0].power_share == 1.0
    assert "cell N measured at" in found[-1][0].reason


def test_a_stuck_sensor_is_found_by_the_model_that_moves_on() -> None:
    stuck: dict[str, float] = {}

    def lie(state: VehicleState) -> VehicleState:
        kept = stuck.setdefault("k", state.cell_1_temperature_k)
        return replace(state, cell_1_temperature_k=kept)

    found = drive(lie)
    assert first_s(found, PackFault.ONE_SENSOR) <= 10.0
    assert all(abs(error) < 2.0 for error in errors_k(found, "cell_1_temperature_k"))


def test_two_bad_sensors_reduce_the_power_in_steps() -> None:
    def lie(state: VehicleState) -> VehicleState:
        return replace(state, cell_1_temperature_k=math.nan, cell_n_temperature_k=233.15)

    found = drive(lie, 300)
    assert first_s(found, PackFault.BOTH_SENSORS) == 0.0
    shares = [report.power_share for report, _ in found]
    assert sorted(set(shares), reverse=True) == pytest.approx([1.0, 0.8, 0.6, 0.4, 0.3])
    assert shares == sorted(shares, reverse=True)
    for name in ("cell_1_temperature_k", "cell_n_temperature_k"):
        assert all(abs(error) < 2.5 for error in errors_k(found, name))


def test_a_sensor_that_is_right_again_is_used_again() -> None:
    found = drive(lambda s: replace(s, cell_1_temperature_k=233.15) if s.time_s < 60.0 else s)
    assert found[65][0].faults == (PackFault.ONE_SENSOR,)
    assert found[75][0].faults == ()
    assert found[75][0].state == found[75][1]


def test_both_cells_wrong_from_the_start_contradict_the_coolant() -> None:
    def lie(state: VehicleState) -> VehicleState:
        colder = {
            f"cell_{n}_temperature_k": getattr(state, f"cell_{n}_temperature_k") - 10.0
            for n in "1n"
        }
        return replace(state, **colder)

    found = drive(lie, 60, fault_s=0.0)
    assert PackFault.CONTRADICTION in found[-1][0].faults
    report, state = found[-1]
    assert report.state is not None
    # The warmer of the two counts: that of the coolant.
    assert report.state.cell_n_temperature_k == pytest.approx(state.cell_n_temperature_k, abs=3.0)


def test_a_wrong_first_value_does_not_lock_out_sound_sensors() -> None:
    def lie(state: VehicleState) -> VehicleState:
        hot = dict.fromkeys(("cell_1_temperature_k", "cell_n_temperature_k"), 372.0)
        return replace(state, **hot) if state.time_s == 0.0 else state

    assert drive(lie, 30, coolant=False, fault_s=0.0)[-1][0].faults == ()


def test_a_dead_compressor_that_echoes_its_command_is_noticed_by_its_effect() -> None:
    found = drive(lambda state: state, 90, dead=True)
    noticed = [state.time_s for report, state in found if PackFault.NO_EFFECT in report.faults]
    assert noticed
    assert noticed[0] <= 60.0


def test_a_compressor_that_shows_that_it_stands_is_noticed() -> None:
    found = drive(lambda state: replace(state, compressor_power_w=0.0), 90)
    assert first_s(found, PackFault.NOT_FOLLOWED) <= 60.0


@pytest.mark.parametrize("value", [math.nan, 1e9])
def test_other_values_of_the_pack_are_the_last_ones(value: float) -> None:
    found = drive(lambda state: replace(state, cell_1_capacity_loss=value), 60)
    report, state = found[-1]
    assert report.faults == (PackFault.OTHER_VALUE,)
    assert report.state is not None
    assert report.state.cell_1_capacity_loss == pytest.approx(state.cell_1_capacity_loss, rel=1e-3)
    assert "cell_1_capacity_loss is" in report.reason

"""Sensors and cooling of the pack under faults, driven in the loop without ROS: what must be reported."""

from __future__ import annotations

import numpy as np
import pytest

from iptm.closed_loop import run_closed_loop
from iptm.faults.fault import Fault
from iptm.faults.injection import FaultInjection, FaultyPlant
from iptm.faults.kinds import FaultKind
from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.pack_observer import PackFault
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend
from iptm_controller.strategy import strategy_by_name
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.settings import ThermalModel
from iptm_core.state import Command
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.interval import PlantStep

HOT = load_parameters(
    overrides={"environment.initial_cell_temperature_k": 36.0 + CELSIUS_ZERO_K}
).values
OPTIONS = ControllerOptions(horizon=Horizon.parse("2x1"), strategy=strategy_by_name("production"))
START_S, END_S, TICKS = 40.0, 130.0, 160
ONE, BOTH = PackFault.ONE_SENSOR, PackFault.BOTH_SENSORS


@pytest.fixture(scope="module")
def solver() -> SolverBackend:
    return build_solver(OPTIONS.horizon, HOT, OPTIONS.solver)


Drive = tuple[list[tuple[PackFault, ...]], list[PlantStep]]


def drive(solver: SolverBackend, *faults: Fault) -> Drive:
    """Follow a leader with a hot pack; return what is reported at each tick, and the true steps."""
    route = build_route("us06", "flat", initial_gap_m=HOT.gap.initial_gap_m, duration_s=TICKS)
    plant = FaultyPlant(faults, HOT, route.slope.slope_at)
    controller = MpcController(HOT, OPTIONS, solver)
    reported: list[tuple[PackFault, ...]] = []

    def keep(_: int, __: Measurements, decision: Decision) -> None:
        assert decision.pack is not None
        reported.append(decision.pack.faults)

    steps: list[PlantStep] = []
    run = run_closed_loop(
        route,
        plant,
        controller,
        on_tick=keep,
        faults=FaultInjection(faults),
        on_step=lambda step, _: steps.append(step),
    )
    assert not run.ended
    return reported, steps


@pytest.mark.parametrize(
    ("kind", "size", "expected", "within_s"),
    [
        (FaultKind.CELL_N_TEMPERATURE_OPEN, None, ONE, 0.0),
        (FaultKind.CELL_N_TEMPERATURE_NAN, None, ONE, 0.0),
        (FaultKind.CELL_TEMPERATURES_NAN, None, BOTH, 0.0),
        (FaultKind.CELL_N_TEMPERATURE_BIAS, None, ONE, 0.0),
        (FaultKind.CELL_N_TEMPERATURE_BIAS, -10.0, ONE, 0.0),
        (FaultKind.CELL_N_TEMPERATURE_STUCK, None, ONE, 60.0),
        (FaultKind.CELL_TEMPERATURES_OPEN, None, BOTH, 0.0),
        (FaultKind.CELL_TEMPERATURES_STUCK, None, BOTH, 60.0),
        (FaultKind.TEMPERATURE_BIAS, -10.0, BOTH, 0.0),
        (FaultKind.COMPRESSOR_DEAD, None, PackFault.NOT_FOLLOWED, 60.0),
        (FaultKind.PUMP_OFF, None, PackFault.NO_EFFECT, 60.0),
    ],
)
def test_each_fault_is_reported_in_time_and_its_end_too(
    solver: SolverBackend,
    kind: FaultKind,
    size: float | None,
    expected: PackFault,
    within_s: float,
) -> None:
    fault = Fault(kind, START_S, END_S - START_S, size=size)
    reported, _ = drive(solver, fault)
    assert not any(reported[: int(START_S)])
    first_s = next(tick for tick, faults in enumerate(reported) if expected in faults)
    assert first_s <= START_S + within_s
    assert reported[-1] == ()


def test_a_dead_compressor_draws_nothing(solver: SolverBackend) -> None:
    _, steps = drive(solver, Fault(FaultKind.COMPRESSOR_DEAD, START_S, END_S - START_S))
    powers_w = np.array([step.powers.compressor_power_w for step in steps])
    assert powers_w[int(START_S)] > 0.0
    assert not powers_w[int(START_S) + 1 : int(END_S) + 1].any()
    assert powers_w[-1] > 0.0


def test_without_flow_the_cells_lose_no_heat_to_the_coolant(solver: SolverBackend) -> None:
    _, sound = drive(solver)
    _, steps = drive(solver, Fault(FaultKind.PUMP_OFF, START_S, END_S - START_S))
    hit = slice(int(START_S) + 1, int(END_S) + 1)
    assert max(step.powers.chiller_heat_w for step in sound[hit]) > 1000.0
    assert max(abs(step.powers.chiller_heat_w) for step in steps[hit]) < 1.0
    for step in steps[hit]:
        assert step.coolant_inlet_temperature_k == step.coolant_outlet_temperature_k
    hotter_k = (
        steps[int(END_S)].state.cell_1_temperature_k - sound[int(END_S)].state.cell_1_temperature_k
    )
    assert hotter_k > 0.1


@pytest.mark.parametrize("model", ThermalModel)
def test_without_flow_the_heater_does_not_reach_the_cells(model: ThermalModel) -> None:
    cold = load_parameters(
        overrides={
            "environment.initial_cell_temperature_k": CELSIUS_ZERO_K,
            "environment.ambient_temperature_k": CELSIUS_ZERO_K,
            "limits.max_heater_power_w": 3000.0,
        }
    ).values
    rises_k = []
    for faults in ((), (Fault(FaultKind.PUMP_OFF, 0.0, 100.0),)):
        plant = FaultyPlant(faults, cold, np.zeros_like, thermal_model=model)
        state = plant.initial_state()
        for _ in range(60):
            state = plant.advance(state, Command(0.0, -3000.0)).state
        rises_k.append(state.cell_1_temperature_k - CELSIUS_ZERO_K)
    assert rises_k[0] > 0.2
    assert 0.0 < rises_k[1] < 0.05  # by the current that the heater draws

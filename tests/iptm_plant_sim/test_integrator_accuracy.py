"""The integration against itself with finer steps, and against a plain Python evaluation."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.model_numbers import SymbolicModel, numbers_of, shape_of
from iptm_core.physics.power_thermal import CellPair
from iptm_core.routes import Route, build_route
from iptm_core.state import Command, FloatArray, VehicleState
from iptm_plant_sim import integrator
from iptm_plant_sim.actuators import Motion, plan_motion
from iptm_plant_sim.integrator import IntervalIntegrator
from iptm_plant_sim.interval import (
    AT_END,
    INTEGRALS,
    STATES,
    PlantStep,
    PowerBounds,
    sub_step,
)
from iptm_plant_sim.plant import Plant

REFERENCE_STEP_S = 0.1 / 16.0
TICKS = 600

Pair = tuple[VehicleState, PlantStep]


def lively_command(state: VehicleState, target_m_s: float, tick: int) -> Command:
    """Chase the speed of the leader with a compressor that is never at rest."""
    wave = 2000.0 * np.sin(tick / 37.0) + 500.0 * np.sin(tick / 3.0)
    return Command(target_m_s - state.speed_m_s, float(2000.0 + wave))


@pytest.fixture(scope="module")
def us06() -> Route:
    return build_route("us06", "large", initial_gap_m=15.0)


@pytest.fixture(scope="module")
def reference(parameters: ModelParameters, us06: Route) -> list[Pair]:
    """Start state and result of every interval of a lively trip, integrated very finely."""
    plant = Plant(parameters, us06.slope.slope_at, REFERENCE_STEP_S)
    state = plant.initial_state()
    pairs = []
    for tick in range(TICKS):
        target = us06.leader.state_at(tick + 1.0).speed_m_s
        step = plant.advance(state, lively_command(state, target, tick))
        pairs.append((state, step))
        state = step.state
    return pairs


def interval_errors(plant: Plant, reference: list[Pair]) -> dict[str, list[float]]:
    """Relative error of each interval, started from the reference's own states.

    Energies are measured against the gross power that flows, which does not vanish where driving and
    regeneration cancel; temperatures and capacity losses against their own change.
    """
    errors: dict[str, list[float]] = {}
    for start, fine in reference:
        coarse = plant.advance(start, fine.report.requested)
        gross = fine.powers.traction_power_w - 2.0 * fine.regenerative_power_w
        gross += fine.powers.compressor_power_w + fine.powers.auxiliary_power_w
        for name in ("traction_power_w", "battery_power_w"):
            error = abs(getattr(coarse.powers, name) - getattr(fine.powers, name)) / gross
            errors.setdefault(name, []).append(error)
        scale = max(abs(fine.powers.chiller_heat_w), 1.0)
        error = abs(coarse.powers.chiller_heat_w - fine.powers.chiller_heat_w) / scale
        errors.setdefault("chiller_heat_w", []).append(error)
        for name, least in (
            ("cell_1_temperature_k", 1e-5),
            ("cell_n_temperature_k", 1e-5),
            ("cell_1_capacity_loss", 0.0),
            ("cell_n_capacity_loss", 0.0),
        ):
            change = max(abs(getattr(fine.state, name) - getattr(start, name)), least)
            error = abs(getattr(coarse.state, name) - getattr(fine.state, name)) / change
            errors.setdefault(name, []).append(error)
    return errors


def test_every_interval_is_accurate_to_a_thousandth(
    parameters: ModelParameters, us06: Route, reference: list[Pair]
) -> None:
    errors = interval_errors(Plant(parameters, us06.slope.slope_at), reference)
    for name, values in errors.items():
        assert max(values) < 1e-3, name
        assert np.median(values) < 1e-6, name


def test_a_whole_trip_is_accurate_to_a_millionth(
    parameters: ModelParameters, us06: Route, reference: list[Pair]
) -> None:
    plant = Plant(parameters, us06.slope.slope_at)
    state = start = reference[0][0]
    steps = []
    for _, fine in reference:
        step = plant.advance(state, fine.report.requested)
        steps.append(step)
        state = step.state
    end = reference[-1][1].state
    for name in ("cell_1_capacity_loss", "cell_n_capacity_loss", "cell_1_temperature_k"):
        change = abs(getattr(end, name) - getattr(start, name))
        assert getattr(state, name) == pytest.approx(getattr(end, name), abs=1e-6 * change)
    for name in ("traction_power_w", "battery_power_w", "chiller_heat_w"):
        total = sum(getattr(step.powers, name) for step in steps)
        fine_total = sum(getattr(fine.powers, name) for _, fine in reference)
        assert total == pytest.approx(fine_total, rel=1e-6)
    assert state.position_m == pytest.approx(end.position_m, abs=1e-9)


def test_order_is_four_where_the_model_is_smooth(make_plant: Callable[..., Plant]) -> None:
    """Full speed, full throttle, waves in the road: no kink anywhere in the interval."""

    def result(step_s: float) -> np.ndarray:
        plant = make_plant("hills", step_s)
        state = replace(
            plant.initial_state(speed_m_s=25.0), acceleration_m_s2=1.0, compressor_power_w=2000.0
        )
        step = plant.advance(state, Command(1.0, 2000.0), 8.0)
        end = step.state
        return np.array(
            [
                end.cell_1_temperature_k - state.cell_1_temperature_k,
                end.cell_1_capacity_loss - state.cell_1_capacity_loss,
                step.powers.battery_power_w,
            ]
        )

    fine = result(0.05)
    errors = np.array([np.abs(result(step) / fine - 1.0) for step in (4.0, 2.0, 1.0)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders[-1] > 3.7).all()
    assert (orders[-1] < 4.6).all()


def test_undeliverable_power_is_seen_in_the_result(parameters: ModelParameters) -> None:
    exact = IntervalIntegrator(parameters)
    cells = CellPair(308.0, 308.0, 1e-3, 1e-3)
    motion = plan_motion(0.0, 30.0, 1.0, 40.0, 1.0, 4)
    assert exact.integrate(cells, 0.0, motion, np.zeros(9)).finite
    assert not exact.integrate(cells, 1e6, motion, np.zeros(9)).finite


def interpreted(
    functions: Sequence[ca.Function],
    numbers: FloatArray,
    held: FloatArray,
    start: FloatArray,
    motion: Motion,
) -> FloatArray:
    """Return what ``iptm_integrate`` finds on a level road, by the functions themselves."""
    step, end = functions
    values, slopes_rad = ca.DM(start), ca.DM.zeros(3)
    for i, speeds_m_s in enumerate(motion.speeds_m_s):
        moves = motion.accelerations_m_s2[i], held, motion.lengths_s[i], slopes_rad, speeds_m_s
        values = step(values, *moves, numbers)
    last = motion.accelerations_m_s2[-1], held, 0.0, motion.speeds_m_s[-1, -1], numbers
    return np.concatenate([np.array(each).ravel() for each in (values, end(values, *last))])


@pytest.mark.parametrize("name", ["paper_identified", "bmw_i3"])
def test_intervals_in_c_are_those_of_the_functions(name: str, cache: Path) -> None:
    """To the last bit, and another car needs no other library."""
    integrator._program.cache_clear()
    usual = load_parameters(name).values
    bounded = usual.pack_limits.limited
    random = np.random.default_rng(3)
    others = {"body.mass_kg": 1999.5, "cell.nominal_resistance_ohm": 0.0037, "pack.parallel": 7}
    for parameters in (usual, load_parameters(name, others).values):
        shape = shape_of(parameters)
        assert shape == shape_of(usual)
        numbers = numbers_of(parameters, shape)
        functions = sub_step(SymbolicModel.of(shape), bounded=bounded)
        compiled = IntervalIntegrator(parameters, bounded=bounded)
        for _ in range(20):
            held = [random.uniform(0.0, 2e3), random.uniform(0.2, 0.9)]
            bounds = PowerBounds(1e5, 1e5) if bounded else None
            start = np.concatenate([random.uniform(290.0, 310.0, 2), np.zeros(8)])
            motion = plan_motion(
                0.0, random.uniform(0.0, 30.0), random.uniform(-3.0, 2.0), 60.0, 1.0, 4
            )
            level = np.zeros(2 * motion.lengths_s.size + 1)
            found = compiled.integrate(
                CellPair(*start[:4]), held[0], motion, level, held[1], bounds
            )
            given = np.array([*held, *(vars(bounds).values() if bounds else ())])
            expected = interpreted(functions, numbers, given, start, motion)
            assert np.array_equal(
                [getattr(found, each) for each in (*STATES, *INTEGRALS, *AT_END)],
                expected,
                equal_nan=True,
            )
    assert len(list(cache.glob("*.so"))) == 1

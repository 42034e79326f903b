"""What the controller is told under a fault, and how the loop lives with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.forecast import preview_fault
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements, trusted_measurements
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview
from iptm_faults.fault import Fault
from iptm_faults.injection import FaultInjection
from iptm_faults.kinds import KINDS, FaultKind, FaultPlace
from iptm_faults.solver import FaultyController
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop

PARAMETERS = load_parameters().values
OPTIONS = ControllerOptions(horizon=Horizon.parse("5x1"))
START, END, TICKS = 40, 50, 70
HEADLESS = [kind for kind, spec in KINDS.items() if spec.headless]
STATE = Plant(PARAMETERS, lambda _: 0.0).initial_state()
MEASURED = [
    FaultKind.PREVIEW_LOST,
    FaultKind.LEADER_LOST,
    FaultKind.STATE_NAN,
    FaultKind.STATE_OVERHEATED,
    FaultKind.SLOPE_NAN,
]


def at(second: int) -> Measurements:
    times = second + np.arange(31.0)
    leader = LeaderState(float(second), 30.0 + 10.0 * second, 10.0)
    state = replace(STATE, time_s=float(second), position_m=10.0 * second, speed_m_s=10.0)
    preview = LeaderPreview(float(second), times, 30.0 + 10.0 * times, np.full(31, 10.0))
    return Measurements(state, leader, preview, SlopePreview(np.array([0.0, 1e3]), np.zeros(2)))


def told(kind: FaultKind, *seconds: int, size: float | None = None) -> list[Measurements]:
    injection = FaultInjection([Fault(kind, 2.0, 10.0, size=size)])
    answers = {second: injection.disturb(at(second))[1] for second in range(max(seconds) + 1)}
    return [answers[second] for second in seconds]


@pytest.mark.parametrize("kind", HEADLESS)
def test_before_and_after_its_time_a_fault_of_measurements_changes_nothing(kind: FaultKind) -> None:
    if KINDS[kind].place is FaultPlace.TRAFFIC:
        pytest.skip("an event in traffic has consequences")
    for second, measured in zip((1, 12), told(kind, 1, 12), strict=True):
        assert measured.state == at(second).state
        assert measured.leader == at(second).leader
        assert np.array_equal(measured.preview.positions_m, at(second).preview.positions_m)
        assert np.array_equal(measured.slope.slopes_rad, at(second).slope.slopes_rad)


def test_frozen_previews_have_fresh_stamps_and_stale_ones_do_not() -> None:
    (frozen,), (stale,) = told(FaultKind.PREVIEW_FROZEN, 7), told(FaultKind.PREVIEW_STALE, 7)
    assert frozen.preview.generated_at_s == 7.0
    assert stale.preview.generated_at_s == 2.0
    for measured in (frozen, stale):
        assert np.array_equal(measured.preview.positions_m, at(2).preview.positions_m)


@pytest.mark.parametrize("kind", [FaultKind.PREVIEW_NAN, FaultKind.PREVIEW_UNORDERED])
def test_spoilt_previews_are_recognised(kind: FaultKind) -> None:
    for measured in told(kind, 3, 4, 5):
        assert preview_fault(measured.preview)
        assert measured.preview.times_s[0] == measured.preview.generated_at_s


@pytest.mark.parametrize("kind", [FaultKind.PREVIEW_LOST, FaultKind.PREVIEW_EMPTY])
def test_what_does_not_arrive_is_empty(kind: FaultKind) -> None:
    (measured,) = told(kind, 4)
    assert measured.preview.times_s.size == 0


def test_a_preview_from_the_future_is_generated_later() -> None:
    (measured,) = told(FaultKind.PREVIEW_FUTURE, 4, size=5.0)
    assert measured.preview.generated_at_s == 9.0


def test_a_jumping_preview_differs_every_tick_and_never_goes_back() -> None:
    shifts = [
        measured.preview.positions_m[-1] - at(second).preview.positions_m[-1]
        for second, measured in zip(
            (3, 4, 5), told(FaultKind.PREVIEW_JUMPING, 3, 4, 5), strict=True
        )
    ]
    assert len(set(shifts)) == 3
    for measured in told(FaultKind.PREVIEW_JUMPING, 3, 4, 5, size=1000.0):
        assert np.all(np.diff(measured.preview.positions_m) >= 0.0)


@pytest.mark.parametrize(
    "kind",
    [FaultKind.LEADER_LOST, FaultKind.LEADER_NAN, FaultKind.STATE_NAN, FaultKind.STATE_OVERHEATED],
)
def test_implausible_measurements_are_not_trusted(kind: FaultKind) -> None:
    (measured,) = told(kind, 4)
    assert trusted_measurements(measured).fault


def test_an_overlap_is_measured_behind_the_front_of_the_host() -> None:
    (measured,) = told(FaultKind.LEADER_OVERLAP, 4, size=3.0)
    assert measured.leader is not None
    assert measured.leader.position_m == 10.0 * 4 - 3.0


def test_the_map_is_steeper_by_the_size() -> None:
    (measured,) = told(FaultKind.SLOPE_STEP, 4, size=0.1)
    assert measured.slope.slopes_rad.tolist() == [0.1, 0.1]


# --- in the loop


@pytest.fixture(scope="module")
def solver() -> SolverBackend:
    return build_solver(OPTIONS.horizon, PARAMETERS, OPTIONS.solver)


@pytest.fixture(scope="module")
def drive(solver: SolverBackend) -> Callable[..., ClosedLoopRun]:
    """Drive the beginning of a city cycle under faults."""
    route = build_route(
        "nycc", "flat", initial_gap_m=PARAMETERS.gap.initial_gap_m, duration_s=TICKS
    )

    def run(*faults: Fault) -> ClosedLoopRun:
        plant = Plant(PARAMETERS, route.slope.slope_at)
        sound = Controller(PARAMETERS, OPTIONS, solver)
        controller = FaultyController(PARAMETERS, sound, faults, lambda _: None)
        return run_closed_loop(route, plant, controller, disturb=FaultInjection(faults).disturb)

    return run


def test_without_faults_the_loop_is_the_same(
    drive: Callable[..., ClosedLoopRun], solver: SolverBackend
) -> None:
    route = build_route(
        "nycc", "flat", initial_gap_m=PARAMETERS.gap.initial_gap_m, duration_s=TICKS
    )
    plant = Plant(PARAMETERS, route.slope.slope_at)
    plain = run_closed_loop(route, plant, Controller(PARAMETERS, OPTIONS, solver))
    assert np.array_equal(drive().trajectory.position_m, plain.trajectory.position_m)


@pytest.mark.parametrize("kind", HEADLESS)
def test_every_kind_runs_without_ros_twice_alike(
    drive: Callable[..., ClosedLoopRun], kind: FaultKind
) -> None:
    fault = Fault(kind, START, END - START, probability=1.0, seed=3)
    first, second = drive(fault), drive(fault)
    assert np.array_equal(first.trajectory.position_m, second.trajectory.position_m)
    assert (first.decisions.rung[:START] == Rung.OPTIMAL).all()
    if kind is not FaultKind.LEADER_GONE:  # too much for a horizon of 5 s
        assert first.decisions.rung[-1] == Rung.OPTIMAL


@pytest.mark.parametrize("kind", MEASURED)
def test_faults_of_measurements_leave_the_true_leader_alone(
    drive: Callable[..., ClosedLoopRun], kind: FaultKind
) -> None:
    faulty, sound = drive(Fault(kind, START, END - START)), drive()
    assert np.array_equal(faulty.trajectory.leader_position_m, sound.trajectory.leader_position_m)


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        (FaultKind.SOLVER_TIMEOUT, SolveStatus.DEADLINE),
        (FaultKind.SOLVER_NOT_CONVERGED, SolveStatus.ITERATION_LIMIT),
    ],
)
def test_a_solver_fails_for_as_long_as_it_is_told_to(
    drive: Callable[..., ClosedLoopRun], kind: FaultKind, status: SolveStatus
) -> None:
    run = drive(Fault(kind, START, END - START))
    failed = np.flatnonzero(run.decisions.status == status)
    assert failed.tolist() == list(range(START, END))

"""Measurements of the controller under a fault, and the closed loop with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm.closed_loop import ClosedLoopRun, run_closed_loop
from iptm.faults.fault import Fault
from iptm.faults.injection import FaultInjection, FaultyController, FaultyPlant
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm_controller.controller import MpcController
from iptm_controller.forecast import preview_fault
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements, trusted_measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview
from iptm_plant_sim.plant import Plant

PARAMETERS = load_parameters().values
OPTIONS = ControllerOptions(horizon=Horizon.parse("5x1"))
START, END, TICKS = 40, 50, 70
HEADLESS = [kind for kind in FaultKind if kind.spec.headless]
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
    preview = LeaderPreview(times, 30.0 + 10.0 * times, np.full(31, 10.0))
    return Measurements(state, leader, preview, SlopePreview(np.array([0.0, 1e3]), np.zeros(2)))


def received(kind: FaultKind, *seconds: int, size: float | None = None) -> list[Measurements]:
    injection = FaultInjection([Fault(kind, 2.0, 10.0, size=size)])
    answers = {second: injection.disturb(at(second))[1] for second in range(max(seconds) + 1)}
    return [answers[second] for second in seconds]


@pytest.mark.parametrize("kind", HEADLESS)
def test_before_and_after_its_time_a_fault_of_measurements_changes_nothing(kind: FaultKind) -> None:
    if kind.spec.place is FaultPlace.TRAFFIC:
        pytest.skip("an event in traffic has consequences")
    for second, measured in zip((1, 12), received(kind, 1, 12), strict=True):
        assert measured.state == at(second).state
        assert measured.leader == at(second).leader
        assert np.array_equal(measured.preview.positions_m, at(second).preview.positions_m)
        assert np.array_equal(measured.slope.slopes_rad, at(second).slope.slopes_rad)


def test_frozen_previews_have_fresh_stamps_and_stale_ones_do_not() -> None:
    (frozen,), (stale,) = (
        received(FaultKind.PREVIEW_FROZEN, 7),
        received(FaultKind.PREVIEW_STALE, 7),
    )
    assert frozen.preview.generated_at_s == 7.0
    assert stale.preview.generated_at_s == 2.0
    for measured in (frozen, stale):
        assert np.array_equal(measured.preview.positions_m, at(2).preview.positions_m)


@pytest.mark.parametrize("kind", [FaultKind.PREVIEW_NAN, FaultKind.PREVIEW_UNORDERED])
def test_spoilt_previews_are_recognised(kind: FaultKind) -> None:
    for measured in received(kind, 3, 4, 5):
        assert preview_fault(measured.preview)
        assert measured.preview.times_s[0] == measured.preview.generated_at_s


@pytest.mark.parametrize("kind", [FaultKind.PREVIEW_LOST, FaultKind.PREVIEW_EMPTY])
def test_what_does_not_arrive_is_empty(kind: FaultKind) -> None:
    (measured,) = received(kind, 4)
    assert measured.preview.times_s.size == 0


def test_a_preview_from_the_future_is_generated_later() -> None:
    (measured,) = received(FaultKind.PREVIEW_FUTURE, 4, size=5.0)
    assert measured.preview.generated_at_s == 9.0


def test_a_jumping_preview_differs_every_tick_and_never_goes_back() -> None:
    shifts = [
        measured.preview.positions_m[-1] - at(second).preview.positions_m[-1]
        for second, measured in zip(
            (3, 4, 5), received(FaultKind.PREVIEW_JUMPING, 3, 4, 5), strict=True
        )
    ]
    assert len(set(shifts)) == 3
    for measured in received(FaultKind.PREVIEW_JUMPING, 3, 4, 5, size=1000.0):
        assert np.all(np.diff(measured.preview.positions_m) >= 0.0)


@pytest.mark.parametrize(
    "kind",
    [FaultKind.LEADER_LOST, FaultKind.LEADER_NAN, FaultKind.STATE_NAN],
)
def test_implausible_measurements_are_not_trusted(kind: FaultKind) -> None:
    (measured,) = received(kind, 4)
    assert trusted_measurements(measured)[2]


def test_an_overlap_is_measured_behind_the_front_of_the_ego() -> None:
    (measured,) = received(FaultKind.LEADER_OVERLAP, 4, size=3.0)
    assert measured.leader is not None
    assert measured.leader.position_m == 10.0 * 4 - 3.0


def test_the_map_is_steeper_by_the_size() -> None:
    (measured,) = received(FaultKind.SLOPE_STEP, 4, size=0.1)
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
        plant = FaultyPlant(faults, PARAMETERS, route.slope.slope_at)
        sound = MpcController(PARAMETERS, OPTIONS, solver)
        controller = FaultyController(PARAMETERS, sound, faults, lambda _: None)
        return run_closed_loop(route, plant, controller, faults=FaultInjection(faults))

    return run


def test_without_faults_the_loop_is_the_same(
    drive: Callable[..., ClosedLoopRun], solver: SolverBackend
) -> None:
    route = build_route(
        "nycc", "flat", initial_gap_m=PARAMETERS.gap.initial_gap_m, duration_s=TICKS
    )
    plant = Plant(PARAMETERS, route.slope.slope_at)
    plain = run_closed_loop(route, plant, MpcController(PARAMETERS, OPTIONS, solver))
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
def test_a_solver_fails_for_as_long_as_the_fault_lasts(
    drive: Callable[..., ClosedLoopRun], kind: FaultKind, status: SolveStatus
) -> None:
    run = drive(Fault(kind, START, END - START))
    failed = np.flatnonzero(run.decisions.status == status)
    assert failed.tolist() == list(range(START, END))


# --- previews, noise and delays


def test_an_empty_preview_stays_empty_whatever_else_happens_to_it() -> None:
    for kind in (kind for kind in FaultKind if kind.spec.place is FaultPlace.PREVIEW):
        faults = [Fault(FaultKind.PREVIEW_EMPTY, 2.0), Fault(kind, 2.0)]
        for second in range(6):
            measured = FaultInjection(faults).disturb(at(second))[1]
            assert second < 2 or measured.preview.times_s.size == 0


@pytest.mark.parametrize(
    ("size", "speed_m_s", "distance_m"), [(0.0, 10.0, 300.0), (1.0, 40.0, 750.0), (-1.0, 0.0, 50.0)]
)
def test_an_extrapolated_preview_keeps_its_acceleration_from_the_measured_leader(
    size: float, speed_m_s: float, distance_m: float
) -> None:
    (measured,) = received(FaultKind.PREVIEW_EXTRAPOLATED, 4, size=size)
    preview, leader = measured.preview, measured.leader
    assert leader is not None
    assert (preview.positions_m[0], preview.speeds_m_s[0]) == (leader.position_m, leader.speed_m_s)
    assert preview.speeds_m_s[-1] == pytest.approx(speed_m_s)
    assert preview.positions_m[-1] - preview.positions_m[0] == pytest.approx(distance_m)


NOISES = {
    FaultKind.GAP_NOISE: ("leader", "position_m"),
    FaultKind.LEADER_SPEED_NOISE: ("leader", "speed_m_s"),
    FaultKind.EGO_SPEED_NOISE: ("state", "speed_m_s"),
    FaultKind.ACCELERATION_NOISE: ("state", "acceleration_m_s2"),
    FaultKind.TEMPERATURE_NOISE: ("state", "cell_n_temperature_k"),
}


@pytest.mark.parametrize("kind", NOISES)
@pytest.mark.parametrize("probability", [1.0, 0.3])
def test_noise_has_no_mean_and_the_deviation_of_its_size(
    kind: FaultKind, probability: float
) -> None:
    where, name = NOISES[kind]
    fault = Fault(kind, 0.0, 4000.0, probability=probability, size=0.25)
    injection = FaultInjection([fault])
    errors = []
    for second in range(4000):
        if not fault.hits(second * 10**9):
            continue
        true, measured = at(second), injection.disturb(at(second))[1]
        errors.append(getattr(getattr(measured, where), name) - getattr(getattr(true, where), name))
    assert np.mean(errors) == pytest.approx(0.0, abs=0.25 * 4 / len(errors) ** 0.5)
    assert np.std(errors) == pytest.approx(0.25, rel=3 / len(errors) ** 0.5)


@pytest.mark.parametrize("kind", [kind for kind in FaultKind if kind.value.endswith("_bias")])
def test_a_bias_adds_its_size_to_one_signal(kind: FaultKind) -> None:
    (measured,) = received(kind, 4, size=-0.5)
    true = at(4)
    assert measured.state is not None
    assert measured.leader is not None
    pairs = ((measured.state, true.state), (measured.leader, true.leader))
    differences = [
        getattr(faulty_part, name) - value
        for faulty_part, true_part in pairs
        for name, value in vars(true_part).items()
    ]
    changed = [difference for difference in differences if difference != 0.0]
    assert changed == pytest.approx([-0.5] * (2 if kind is FaultKind.TEMPERATURE_BIAS else 1))


def test_delayed_measurements_keep_their_own_time() -> None:
    late, last, back = received(FaultKind.STATE_DELAYED, 3, 11, 12, size=2.0)
    times = [
        (one.state and one.state.time_s, one.leader and one.leader.time_s)
        for one in (late, last, back)
    ]
    assert times == [(1.0, 1.0), (9.0, 9.0), (12.0, 12.0)]


def test_delays_at_the_same_time_add_up() -> None:
    sizes = (2.0, 3.0)
    injection = FaultInjection(
        [Fault(FaultKind.STATE_DELAYED, 2.0, 10.0, size=size) for size in sizes]
    )
    heard = [injection.disturb(at(second))[1] for second in range(10)]
    last = heard[-1].state
    assert last is not None
    assert last.time_s == 9.0 - sum(sizes)


def lead_samples(second: int) -> LeaderPreview:
    times = second + 0.5 * np.arange(2)
    return LeaderPreview(times, 30.0 + 10.0 * times, np.full(2, 10.0))


def test_a_frozen_range_sensor_repeats_gap_and_speed_of_its_first_tick() -> None:
    injection = FaultInjection([Fault(FaultKind.LEADER_FROZEN, 2.0, 3.0)])
    for second in range(6):
        true = at(second)
        closer = replace(
            true, leader=replace(true.leader, position_m=30.0 + 9.0 * second, speed_m_s=9.0)
        )
        leader = injection.disturb(closer)[1].leader
        samples = injection.sampled(lead_samples(second), 10.0 * second)
        if second in {2, 3, 4}:
            assert leader == LeaderState(float(second), 10.0 * second + 28.0, 9.0)
            assert np.array_equal(samples.positions_m, np.full(2, 10.0 * second + 28.0))
        else:
            assert leader == closer.leader
            assert np.array_equal(samples.positions_m, lead_samples(second).positions_m)


def test_a_vanished_vehicle_leaves_an_empty_lane_and_a_lost_one_nothing() -> None:
    for kind, samples in ((FaultKind.LEADER_VANISHED, 0), (FaultKind.LEADER_LOST, None)):
        injection = FaultInjection([Fault(kind, 2.0, 3.0)])
        measured = injection.sampled(lead_samples(3), 30.0)
        assert (None if measured is None else measured.times_s.size) == samples
        assert injection.disturb(at(3))[1].leader is None


def test_rounding_is_that_of_the_gap_and_of_the_speed() -> None:
    (gap,) = received(FaultKind.GAP_ROUNDED, 3, size=7.0)
    assert gap.leader == LeaderState(3.0, 30.0 + 28.0, 10.0), "30 m in steps of 7 m"
    (speed,) = received(FaultKind.LEADER_SPEED_ROUNDED, 3, size=4.0)
    assert speed.leader == LeaderState(3.0, 60.0, 8.0)

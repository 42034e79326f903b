"""Faults over ROS 2: the injector matches the pure part, and operation recovers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.drives import trip
from studies.faults.catalogue import Entry, trial_on
from studies.faults.judge import judge_trial
from studies.session import inputs_of
from studies.trial import (
    INPUT_TIMEOUT_S,
    DriveMode,
    DrivenTrial,
    Trial,
    drive_headless,
    drive_over_ros,
)

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm_controller.pack_observer import PackFault
from iptm_core.decision_record import Rung
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS

TRIP_S = 120.0
PARAMETERS = load_parameters().values
OverRos = Callable[[Trial], DrivenTrial]

OF_TOPICS = (
    Fault(FaultKind.LEADER_CUT_IN, 20.0, 8.0, size=8.0),
    Fault(FaultKind.PREVIEW_JUMPING, 25.0, 10.0, 0.5, seed=1),
    Fault(FaultKind.SLOPE_STEP, 40.0, 10.0, size=0.05),
    Fault(FaultKind.LEADER_JUMPING, 45.0, 5.0, size=2.0),
    Fault(FaultKind.PREVIEW_FROZEN, 55.0, 5.0),
    Fault(FaultKind.SOLVER_NOT_CONVERGED, 65.0, 4.0),
    Fault(FaultKind.STATE_JUMPING, 75.0, 5.0, size=2.0),
    Fault(FaultKind.LEADER_HARD_STOP, 85.0, 8.0, size=3.0),
    Fault(FaultKind.CELL_N_TEMPERATURE_STUCK, 30.0, 8.0),
    Fault(FaultKind.CELL_TEMPERATURES_OPEN, 40.0, 12.0),
    Fault(FaultKind.PUMP_OFF, 50.0, 40.0),
    Fault(FaultKind.COMPRESSOR_DEAD, 95.0, 10.0),
    # Together, and until the end of the trip.
    Fault(FaultKind.EGO_SPEED_NOISE, 60.0, TRIP_S, size=0.05),
    Fault(FaultKind.ACCELERATION_NOISE, 60.0, TRIP_S, size=0.02),
    Fault(FaultKind.TEMPERATURE_NOISE, 60.0, TRIP_S),
    Fault(FaultKind.GAP_NOISE, 60.0, TRIP_S, size=0.2),
    Fault(FaultKind.PREVIEW_EXTRAPOLATED, 70.0, TRIP_S),
    Fault(FaultKind.COMMAND_DELAYED, 80.0, TRIP_S),
    Fault(FaultKind.BRAKES_WEAK, 90.0, TRIP_S),
)


def planned(*faults: Fault, mode: DriveMode = DriveMode.LOCK_STEP) -> Trial:
    return trial_on("us06", TRIP_S, mode, faults)


@pytest.fixture
def over_ros(tmp_path: Path) -> OverRos:
    return lambda trial: drive_over_ros(trial, tmp_path)


@pytest.fixture
def waits_for_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a slow machine change no decision.

    A controller that waits in vain for as long does not answer before the plant begins its controlled stop.
    """
    monkeypatch.setitem(INPUT_TIMEOUT_S, DriveMode.LOCK_STEP, 60.0)


def columns(driven: DrivenTrial, names: Sequence[str]) -> dict[str, np.ndarray]:
    return {name: driven.run.trajectory.to_arrays()[name] for name in names}


@pytest.mark.usefixtures("waits_for_everything")
def test_faults_over_ros_are_those_without(over_ros: OverRos) -> None:
    """Lock-step with faults gives the very numbers of the loop without ROS, so it repeats as well."""
    with_ros = over_ros(planned(*OF_TOPICS))
    without = drive_headless(planned(*OF_TOPICS, mode=DriveMode.HEADLESS))
    assert with_ros.ended == ""
    names = ("time_s", "position_m", "acceleration_m_s2", "leader_position_m")
    for name, values in columns(without, names).items():
        np.testing.assert_array_equal(columns(with_ros, names)[name], values, err_msg=name)


@pytest.mark.usefixtures("waits_for_everything")
def test_a_lost_preview_is_not_waited_for_in_lock_step(over_ros: OverRos) -> None:
    lost = Fault(FaultKind.PREVIEW_LOST, 0.0, TRIP_S, 0.5, seed=1)
    with_ros = over_ros(planned(lost))
    without = drive_headless(planned(lost, mode=DriveMode.HEADLESS))
    for name in ("acceleration_m_s2", "compressor_power_w"):
        here, there = (getattr(one.run.trajectory, name) for one in (without, with_ros))
        np.testing.assert_array_equal(there, here, err_msg=name)


@pytest.mark.usefixtures("waits_for_everything")
def test_the_safety_monitor_brakes_alike_with_and_without_ros(over_ros: OverRos) -> None:
    """A lead vehicle that brakes with 8 m/s^2 against its previews: same bits, a reason, and no collision."""
    surprise = Fault(FaultKind.LEADER_SURPRISE, 60.0, 20.0, size=8.0)
    with_ros = over_ros(planned(surprise))
    without = drive_headless(planned(surprise, mode=DriveMode.HEADLESS))
    assert with_ros.ended == ""
    for name in TRAJECTORY_COLUMNS:
        here, there = (getattr(one.run.trajectory, name) for one in (without, with_ros))
        if name.endswith("temperature_k"):  # degrees Celsius on the wire
            np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-9)
        else:
            np.testing.assert_array_equal(there, here, err_msg=name)
    run = with_ros.run.trajectory
    assert run.service_braking_s.sum() > 0.0
    assert run.closest_m.min() > 0.0
    assert run.acceleration_m_s2.min() < PARAMETERS.limits.min_acceleration_m_s2
    brakings = [one for one in with_ros.reports if "the safety monitor brakes: gap" in one.reason]
    assert brakings
    first = float(run.time_s[np.flatnonzero(run.service_braking_s)[0]])
    assert abs(brakings[0].time_s - first) <= 2.0
    # Over ROS the last state is answered, too.
    rungs = without.run.decisions.rung.tolist()
    assert with_ros.run.decisions.rung.tolist()[: len(rungs)] == rungs


def test_foreign_messages_and_a_restart_are_reported_and_survived(over_ros: OverRos) -> None:
    trial = planned(
        Fault(FaultKind.FOREIGN_CLOCK, 20.0, 3.0),
        Fault(FaultKind.FOREIGN_LEADER, 30.0, 3.0, size=-1e6),
        Fault(FaultKind.PROCESS_RESTARTED, 50.0, target="v2x_bridge"),
    )
    free, driven = drive_headless(planned(mode=DriveMode.HEADLESS)), over_ros(trial)
    for fault, interval in zip(trial.placed, driven.intervals, strict=True):
        of_it = replace(driven, trial=replace(trial, placed=(fault,)), intervals=[interval])
        assert judge_trial(of_it, Entry(fault, normal_within=60), free).problem_text == ""


def test_a_plant_that_is_started_again_is_resumed_and_drives_another_trip(
    over_ros: OverRos,
) -> None:
    fault = Fault(FaultKind.PROCESS_RESTARTED, 20.0, target="plant")
    driven = over_ros(planned(fault))
    assert driven.ended == ""
    assert driven.run.trajectory.time_s[-1] == TRIP_S
    assert "another trip has begun" in {one.reason for one in driven.reports}


@pytest.mark.usefixtures("waits_for_everything")
@pytest.mark.parametrize(
    ("kind", "within_s", "report"),
    [
        (FaultKind.CELL_N_TEMPERATURE_NAN, 10.0, PackFault.ONE_SENSOR),
        (FaultKind.COMPRESSOR_DEAD, 60.0, PackFault.NOT_FOLLOWED),
    ],
)
def test_a_trip_in_the_heat_goes_on_without_a_sensor_or_the_compressor(
    over_ros: OverRos, kind: FaultKind, within_s: float, report: PackFault
) -> None:
    begins_s = 30.0
    inputs = inputs_of(trip("us06", duration_s=TRIP_S, ambient_c=35.0)).checked()
    driven = over_ros(Trial(DriveMode.LOCK_STEP, (Fault(kind, begins_s, TRIP_S),), inputs))
    assert driven.ended == ""
    warned_s = [one.time_s for one in driven.reports if report.value in one.reason]
    assert begins_s <= warned_s[0] <= begins_s + within_s
    run, limits = driven.run.trajectory, PARAMETERS.limits
    assert run.time_s[-1] == TRIP_S
    assert driven.run.decisions.rung.max() == Rung.OPTIMAL
    usual = drive_headless(Trial(DriveMode.HEADLESS, (), inputs)).run.trajectory
    assert run.position_m[-1] == pytest.approx(usual.position_m[-1], abs=10.0)
    assert run.cell_1_temperature_k.min() > limits.min_temperature_k
    assert run.cell_n_temperature_k.max() < limits.max_temperature_k

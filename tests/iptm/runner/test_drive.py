"""How a run ends, seen by a runner that hears little of it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from iptm.runner.drive import DriveOutcome, NodeDrive
from iptm.runner.monitor import Snapshot
from iptm.runner.process_faults import ProcessFaults, unclean_ends
from iptm.runner.supervisor import ProcessEnd
from iptm.trip import Trip
from iptm_core.decision_record import Rung


def drive_of(
    processes: tuple[str, ...], plant_code: int, snapshot: Snapshot | None = None
) -> NodeDrive:
    """Return a drive whose plant has ended and whose monitor has heard no message."""
    meeting = SimpleNamespace(absent=(), missing=(), is_complete=True)
    nothing: Any = SimpleNamespace(
        began_s=None if snapshot is None else 0.0,
        last_clock_s=None,
        last_sign_s=math.inf,
        time_ns=None,
        clocks=0,
        message_count=0,
        plant_reason="",
        awaited_nodes=(),
        deaf_nodes=(),
        start_signal=SimpleNamespace(give=lambda _: False, meeting=meeting),
        crowded_topics=("clock",) if snapshot else (),
        newest_stamp_ns=lambda _: None,
        snapshot=lambda: snapshot,
        expect=lambda _: None,
        is_doubled=lambda _: False,
    )
    supervisor: Any = SimpleNamespace(
        names=processes,
        endings=lambda: (ProcessEnd("plant", plant_code, ("the last words",)),) * (not snapshot),
        is_running=lambda name: snapshot is not None or name != "plant",
    )
    executor: Any = SimpleNamespace(spin_once=lambda **_: None)
    progress: Any = SimpleNamespace(waiting=lambda _: None, running=lambda *_: None)
    stop: Any = SimpleNamespace(number=None)
    faults = ProcessFaults(supervisor, ())
    trip = Trip.of(duration_s=120.0)
    return NodeDrive(supervisor, [nothing], executor, progress, stop, faults, trip)


def test_a_recorded_trip_of_which_the_runner_heard_nothing_is_left_to_the_bag() -> None:
    drive = drive_of(("controller", "recorder", "plant", "v2x_bridge"), 0)
    assert drive.run().outcome is DriveOutcome.FINISHED


@pytest.mark.parametrize(
    ("processes", "code"), [(("controller", "plant"), 0), (("recorder", "plant"), 1)]
)
def test_without_a_witness_or_after_a_failure_it_did_not_finish(
    processes: tuple[str, ...], code: int
) -> None:
    assert drive_of(processes, code).run().outcome is DriveOutcome.FAILED


@pytest.mark.parametrize(
    ("time_s", "gap_m", "found"),
    [
        (375.0, 20.0, "the clock is at 375 s of a trip of 120 s"),
        (90.0, -9399.3, "the gap is -9399 m at 90 s"),
    ],
)
def test_what_no_trip_can_show_ends_the_run_with_its_reason(
    time_s: float, gap_m: float, found: str
) -> None:
    shown = Snapshot(time_s, 37.5, gap_m, 30.0, 30.0, 1e-3, 10, Rung.OPTIMAL)
    result = drive_of(("controller", "recorder", "plant", "v2x_bridge"), 0, shown).run()
    assert result.outcome is DriveOutcome.FAILED
    assert result.message == (
        f"{found}: nodes of another run take part in this ROS domain, which publish clock as well"
    )


def test_a_recorder_that_a_fault_killed_is_reported() -> None:
    endings = (ProcessEnd("recorder", -9, ()), ProcessEnd("controller", -9, ()))
    supervisor: Any = SimpleNamespace(endings=lambda: endings)
    excused: Any = SimpleNamespace(is_excused=lambda _: True)
    (message,) = unclean_ends(supervisor, excused)
    assert message == "the bag is incomplete: recorder was killed by signal 9 (SIGKILL), by a fault"

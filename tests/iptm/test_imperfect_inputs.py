"""Drives on wrong, late or noisy inputs: no collision, and no less way where the disturbance is harmless."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

import iptm
from iptm.faults.fault import WHOLE_TRIP_S, Fault
from iptm.faults.kinds import FaultKind

Drive = Callable[..., iptm.Run]


def whole(kind: FaultKind, size: float | None = None) -> Fault:
    return Fault(kind, duration_s=WHOLE_TRIP_S, size=size)


@dataclass(frozen=True)
class Disturbed:
    """A drive: cycle, length, faults, and whether they are harmless."""

    cycle: str
    duration_s: float
    faults: tuple[Fault, ...]
    harmless: bool = True
    slow: bool = False


def stop_behind_a_frozen_preview(cycle: str, at_s: float, size: float) -> Disturbed:
    frozen = Fault(FaultKind.PREVIEW_FROZEN, at_s - 5.0, 40.0)
    stop = Fault(FaultKind.LEADER_SURPRISE, at_s, 20.0, size=size)
    slow = (cycle, at_s, size) != ("us06", 60.0, 2.0)
    return Disturbed(cycle, at_s + 60.0, (frozen, stop), harmless=False, slow=slow)


CONSTANT = whole(FaultKind.PREVIEW_EXTRAPOLATED)
FASTER = whole(FaultKind.PREVIEW_EXTRAPOLATED, 1.0)
WEAK = whole(FaultKind.BRAKES_WEAK, 0.7)
DRIVES = [
    Disturbed("us06", 150.0, (CONSTANT,)),
    Disturbed("us06", 600.0, (CONSTANT,), slow=True),
    Disturbed("wltc_class3b", 600.0, (CONSTANT,), slow=True),
    Disturbed("nycc", 598.0, (CONSTANT,), slow=True),
    Disturbed("us06", 150.0, (FASTER,)),
    Disturbed("nycc", 598.0, (FASTER,), slow=True),
    *(
        stop_behind_a_frozen_preview(cycle, at_s, size)
        for cycle, at_s in (("us06", 60.0), ("us06", 300.0), ("udds", 200.0))
        for size in (1.5, 2.0)
    ),
    *(
        Disturbed(
            cycle,
            150.0 if cycle == "us06" else 300.0,
            (whole(FaultKind.COMMAND_DELAYED, ticks),),
            slow=cycle != "us06",
        )
        for cycle in ("us06", "nycc")
        for ticks in (1.0, 2.0)
    ),
    Disturbed("us06", 150.0, (whole(FaultKind.EGO_SPEED_BIAS, -1e-9),)),
    Disturbed("us06", 150.0, (WEAK,)),
    Disturbed("us06", 600.0, (WEAK,), slow=True),
]


@pytest.fixture(scope="module")
def drive() -> Drive:
    runs: dict[tuple[str, float, tuple[Fault, ...]], iptm.Run] = {}

    def perform(cycle: str, duration_s: float, faults: tuple[Fault, ...] = ()) -> iptm.Run:
        key = cycle, duration_s, faults
        if key not in runs:
            runs[key] = iptm.simulate(cycle, duration_s=duration_s, faults=faults)
        return runs[key]

    return perform


def identity(disturbed: Disturbed) -> str:
    faults = "_".join(fault.describe().replace(" ", "_") for fault in disturbed.faults)
    return f"{disturbed.cycle}_{disturbed.duration_s:g}_{faults}"


@pytest.mark.parametrize(
    "disturbed",
    [
        pytest.param(one, marks=[pytest.mark.slow] if one.slow else [], id=identity(one))
        for one in DRIVES
    ],
)
def test_imperfect_inputs_end_in_no_collision(drive: Drive, disturbed: Disturbed) -> None:
    trip = drive(disturbed.cycle, disturbed.duration_s, disturbed.faults).trajectory
    assert trip.smallest_gap_m.min() > 0.0
    if disturbed.harmless:
        undisturbed = drive(disturbed.cycle, disturbed.duration_s).trajectory
        assert trip.position_m[-1] >= 0.95 * undisturbed.position_m[-1]


@pytest.mark.parametrize("ahead_s", [0.001, 0.5])
def test_previews_of_a_clock_that_is_ahead_are_worth_what_they_are_in_time(ahead_s: float) -> None:
    ahead = whole(FaultKind.PREVIEW_FUTURE, ahead_s)
    in_time, off = (
        iptm.simulate(cycle="us06", duration_s=60.0, faults=faults).trajectory
        for faults in ((), (ahead,))
    )
    assert off.position_m == pytest.approx(in_time.position_m, abs=0.05)

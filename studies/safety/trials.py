"""Closed-loop trials of safety: what is disturbed, when, and how much."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from studies.drives import DEFAULT, REFERENCE, trip
from studies.session import Case, inputs_of

from iptm.faults.fault import WHOLE_TRIP_S, Fault, in_order
from iptm.faults.kinds import FaultKind
from iptm_core.braking import SafetyMonitorSettings
from iptm_core.routes.cycles import CYCLE_NAMES

LONG_CYCLES = ("comprehensive",)
UNDISTURBED = "undisturbed"
NOISE_AND_DELAY = "noise and one tick of delay"
MEASURED_SHARE = 0.4
"""Probability that a trial is driven behind a measured lead vehicle."""
EARLIEST_S = 10.0
"""No event begins before: the ego vehicle has to drive."""
DELAYS = (0, 1, 2)
NOISE = (
    (FaultKind.GAP_NOISE, 0.5),
    (FaultKind.EGO_SPEED_NOISE, 0.1),
    (FaultKind.LEADER_SPEED_NOISE, 0.1),
    (FaultKind.TEMPERATURE_NOISE, 0.5),
)
"""Standard deviations of the noise of all signals together."""
PREVIEW_ERROR_M_S = 1.5
SEED = 1
MARGIN_M = SafetyMonitorSettings.monitor_margin_m
CYCLES: tuple[str, ...] = (*CYCLE_NAMES, "smooth", *LONG_CYCLES)
PERIODS_S: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0)
DISTURBED_S, DELAYED_S = 300.0, 300.0
"""Largest lengths of a disturbed trial, and of a drive with delayed commands."""
SHIPPED, MEASURED = "shipped cycles", "measured lead vehicles"
"""Kinds of lead vehicles."""


def _duration_s(cycle: str, longest_s: float) -> float | None:
    """Return the length of a part of a cycle, None for all of it."""
    whole_s = inputs_of(trip(cycle)).route.duration_s
    return longest_s if longest_s < whole_s else None


def lasting(*kinds: tuple[FaultKind, float]) -> tuple[Fault, ...]:
    """Return faults that last for the whole trip."""
    return tuple(Fault(kind, duration_s=WHOLE_TRIP_S, size=size, seed=SEED) for kind, size in kinds)


SETTINGS: Mapping[str, Mapping[str, Any]] = {
    UNDISTURBED: {},
    "noise": {"faults": lasting(*NOISE)},
    NOISE_AND_DELAY: {"faults": lasting(*NOISE, (FaultKind.COMMAND_DELAYED, 1.0))},
    "preview errors": {"noise_std_m_s": PREVIEW_ERROR_M_S},
}
"""What is disturbed on whole cycles without any event, by name."""


def driving_cases(
    cycles: Sequence[str] = CYCLES, leads: Sequence[str] = (), longest_s: float = math.inf
) -> list[Case]:
    """Return cycles under every one of `SETTINGS` with their references, and measured lead vehicles.

    Trips of hours are driven undisturbed only.

    Args:
        cycles: driving cycles.
        leads: measured lead vehicles, as paths of drives.
        longest_s: length after which cycles are cut.
    """
    cases = []
    for cycle in cycles:
        duration_s = _duration_s(cycle, longest_s)
        for name, settings in {**SETTINGS, REFERENCE: {}}.items():
            if cycle not in LONG_CYCLES or name in {UNDISTURBED, REFERENCE}:
                role = REFERENCE if name == REFERENCE else DEFAULT
                call = trip(cycle, role, duration_s=duration_s, **settings)
                labels = {"cycle": cycle, "setting": name, "behind": SHIPPED}
                cases.append(Case(f"{cycle}_{name}", labels, call))
    for lead in leads:
        label = Path(lead).stem
        for name in (UNDISTURBED, NOISE_AND_DELAY):
            labels = {"cycle": label, "setting": name, "behind": MEASURED}
            cases.append(Case(f"{label}_{name}", labels, trip(lead, **SETTINGS[name])))
    return cases


def delay_cases(
    cycles: Sequence[str] = CYCLES,
    periods_s: Sequence[float] = PERIODS_S,
    longest_s: float = DELAYED_S,
) -> list[Case]:
    """Return the beginning of published cycles at several periods with commands delayed by whole ticks."""
    cases = []
    for cycle in published(cycles):
        duration_s = _duration_s(cycle, longest_s)
        for period_s, ticks in product(periods_s, DELAYS):
            faults = lasting((FaultKind.COMMAND_DELAYED, float(ticks))) if ticks else ()
            call = trip(cycle, period_s=period_s, faults=faults, duration_s=duration_s)
            labels = {"cycle": cycle, "period_s": period_s, "ticks": ticks}
            cases.append(Case(f"{cycle}_{period_s:g}_s_{ticks}", labels, call))
    return cases


def disturbed_cases(
    trials: int,
    seed: int,
    cycles: Sequence[str] = CYCLES,
    leads: Sequence[str] = (),
    longest_s: float = DISTURBED_S,
) -> list[Case]:
    """Return random trials: what a lead vehicle does, and one or two things that are disturbed.

    Args:
        trials: number of trials.
        seed: of all draws.
        cycles: driving cycles, of which the published ones are driven.
        leads: measured lead vehicles, as paths of drives.
        longest_s: length of a trial at most.
    """
    cases = []
    for number in range(1, trials + 1):
        random = np.random.default_rng([seed, number])
        measured = leads and random.random() < MEASURED_SHARE
        options = leads if measured else published(cycles)
        cycle = options[int(random.integers(len(options)))]
        duration_s = _duration_s(cycle, longest_s)
        route = inputs_of(trip(cycle, duration_s=duration_s)).route
        faults, names = _draw(random, route.duration_s)
        labels = {"cycle": Path(cycle).stem, "disturbed": names}
        call = trip(cycle, duration_s=duration_s, faults=faults, **_stated(faults))
        cases.append(Case(f"{number:04d}", labels, call))
    return cases


def published(cycles: Sequence[str]) -> list[str]:
    """Return the published cycles, of which a few minutes are representative."""
    return [cycle for cycle in cycles if cycle in CYCLE_NAMES]


def _draw(random: Generator, duration_s: float) -> tuple[tuple[Fault, ...], str]:
    """Return the faults of a trial and what they disturb."""
    chosen = random.permutation(len(_DISTURBANCES))[: 1 + int(random.integers(2))]
    names = [list(_DISTURBANCES)[index] for index in sorted(chosen.tolist())]
    drawn: list[Fault] = []
    for name in names:
        kinds = _DISTURBANCES[name]
        options = kinds[int(random.integers(len(kinds)))]
        start_s, length_s = 0.0, WHOLE_TRIP_S
        if random.random() < 0.5:
            start_s, length_s = _round(random.uniform(0.0, 0.8 * duration_s)), 60.0
        seed = int(random.integers(1000))
        for kind, bounds in options:
            size = _round(random.uniform(*bounds)) if bounds else None
            drawn.append(Fault(kind, start_s=start_s, duration_s=length_s, size=size, seed=seed))
    event, low, high = _EVENTS[int(random.integers(len(_EVENTS)))]
    start_s = _round(random.uniform(EARLIEST_S, duration_s - 20.0))
    drawn.append(
        Fault(event, start_s=start_s, duration_s=10.0, size=_round(random.uniform(low, high)))
    )
    return in_order(drawn), ", ".join([str(event), *names])


def _stated(faults: Sequence[Fault]) -> dict[str, Any]:
    """Return the accuracies that cover what is drawn; within the margin of the monitor nothing is stated."""
    gap_m = max((f.magnitude for f in faults if f.kind is FaultKind.GAP_BIAS), default=0.0)
    return {"gap_accuracy_m": gap_m} if gap_m > MARGIN_M else {}


def _round(number: float) -> float:
    return round(float(number), 1)


_Option = tuple[tuple[FaultKind, tuple[float, float] | None], ...]
_EVENTS: tuple[tuple[FaultKind, float, float], ...] = (
    (FaultKind.LEADER_SURPRISE, 2.0, 9.0),
    (FaultKind.LEADER_HARD_STOP, 2.0, 9.0),
    (FaultKind.LEADER_CUT_IN, 4.0, 40.0),
)
_DISTURBANCES: Mapping[str, tuple[_Option, ...]] = {
    "preview": (
        ((FaultKind.PREVIEW_FROZEN, None),),
        ((FaultKind.PREVIEW_EXTRAPOLATED, (0.0, 0.0)),),
        ((FaultKind.PREVIEW_EXTRAPOLATED, (1.0, 1.0)),),
        ((FaultKind.PREVIEW_LOST, None),),
    ),
    "delay": (
        ((FaultKind.COMMAND_DELAYED, (1.0, 1.0)),),
        ((FaultKind.COMMAND_DELAYED, (2.0, 2.0)),),
        ((FaultKind.STATE_DELAYED, (1.0, 1.0)),),
    ),
    "noise": (tuple((kind, (size, size)) for kind, size in NOISE),),
    "bias": (
        ((FaultKind.GAP_BIAS, (-1.0, 1.0)),),
        ((FaultKind.EGO_SPEED_BIAS, (-0.3, 0.3)),),
        ((FaultKind.LEADER_SPEED_BIAS, (-0.3, 0.3)),),
        ((FaultKind.ACCELERATION_BIAS, (-0.3, 0.3)),),
        ((FaultKind.GAP_BIAS, (1.0, 8.0)),),
        ((FaultKind.EGO_POSITION_BIAS, (-5.0, 5.0)),),
    ),
    "range sensor": (
        ((FaultKind.LEADER_FROZEN, None),),
        ((FaultKind.LEADER_VANISHED, None),),
        ((FaultKind.LEADER_LOST, None),),
        ((FaultKind.GAP_ROUNDED, (0.1, 1.0)), (FaultKind.LEADER_SPEED_ROUNDED, (0.1, 0.5))),
    ),
    "road": (
        ((FaultKind.ROAD_SLIPPERY, (0.3, 0.6)),),
        ((FaultKind.ROAD_STEEPER, (-0.12, 0.12)),),
        ((FaultKind.ROAD_SLIPPERY, (0.4, 0.6)), (FaultKind.ROAD_STEEPER, (-0.1, 0.0))),
    ),
    "brakes": (((FaultKind.BRAKES_WEAK, (0.6, 0.85)),), ((FaultKind.BRAKES_WEAK, (0.85, 1.0)),)),
}
"""What may be disturbed, and the forms of it: kinds with the range of their size."""

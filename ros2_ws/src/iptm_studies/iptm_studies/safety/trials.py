"""Closed-loop trials of safety as studies: what is disturbed, when, and how much."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.routes import CYCLE_NAMES
from iptm_faults.fault import WHOLE_TRIP_S, Fault, in_order
from iptm_faults.kinds import FaultKind
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import PreviewSpec, RunSpec
from iptm_studies.study import Case, Label, Study

LONG_CYCLES = ("comprehensive",)
UNDISTURBED = "undisturbed"
NOISE_AND_DELAY = "noise and one tick of delay"
REFERENCE = "reference"
REFERENCE_HORIZON = "15x1"
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

_DEFAULT = ControllerSettings()


@dataclass(frozen=True)
class Extent:
    """How much is driven.

    Attributes:
        leads: measured lead vehicles, as paths of drives.
        longest_s: of a cycle without events; the rest of it is left out.
        delayed_s: of a cycle with commands delayed at several ``periods_s``.
        disturbed_s: of a disturbed trial.
        trials: number of disturbed trials.
        braking_trials: number of trials with the monitor alone.
    """

    cycles: tuple[str, ...] = (*CYCLE_NAMES, "smooth", *LONG_CYCLES)
    leads: tuple[str, ...] = ()
    longest_s: float = math.inf
    delayed_s: float = 600.0
    disturbed_s: float = 300.0
    periods_s: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0)
    trials: int = 1000
    braking_trials: int = 20_000
    seed: int = 1

    @property
    def lively_cycles(self) -> tuple[str, ...]:
        """Published cycles, of which a few minutes are representative."""
        return tuple(cycle for cycle in self.cycles if cycle in CYCLE_NAMES)


SHORT = Extent(
    cycles=("nycc",),
    longest_s=40.0,
    delayed_s=40.0,
    disturbed_s=40.0,
    periods_s=(1.0,),
    trials=2,
    braking_trials=4,
)
"""Every part of the trials within seconds."""


def _duration_s(cycle: str, longest_s: float) -> float | None:
    """Return the length of a part of a cycle, None for all of it."""
    whole_s = resolve_inputs(default_spec(cycle)).route.duration_s
    return longest_s if longest_s < whole_s else None


def default_spec(cycle: str, **settings: Any) -> RunSpec:
    """Return a run of the default strategy with the settings of the controller."""
    return RunSpec(
        cycle=cycle,
        strategy=strategy_by_name(_DEFAULT.strategy),
        horizon=_DEFAULT.horizon,
        **settings,
    )


def lasting(*kinds: tuple[FaultKind, float]) -> tuple[Fault, ...]:
    """Return faults that last for the whole trip."""
    return tuple(Fault(kind, duration_s=WHOLE_TRIP_S, size=size, seed=SEED) for kind, size in kinds)


SETTINGS: Mapping[str, Mapping[str, Any]] = {
    UNDISTURBED: {},
    "noise": {"faults": lasting(*NOISE)},
    NOISE_AND_DELAY: {"faults": lasting(*NOISE, (FaultKind.COMMAND_DELAYED, 1.0))},
    "preview errors": {"preview": PreviewSpec(noise_std_m_s=PREVIEW_ERROR_M_S)},
}
"""What is disturbed on whole cycles without any event, by name."""


def driving_study(extent: Extent) -> Study:
    """Return whole cycles under every one of `SETTINGS` with their references, and measured lead vehicles.

    Trips of hours are driven undisturbed only.
    """
    cases = [
        Case(f"{cycle}_{name}", {"cycle": cycle, "setting": name}, spec)
        for cycle in extent.cycles
        for name, spec in _settings_of(cycle, extent.longest_s)
        if cycle not in LONG_CYCLES or name in {UNDISTURBED, REFERENCE}
    ]
    for lead in extent.leads:
        label = Path(lead).stem
        for name in (UNDISTURBED, NOISE_AND_DELAY):
            labels: dict[str, Label] = {"cycle": label, "setting": name, "measured": 1}
            spec = default_spec(lead, **SETTINGS[name])
            cases.append(Case(f"{label}_{name}", labels, spec))
    return Study("safety_driving", "Driving without events", "", tuple(cases))


def _settings_of(cycle: str, longest_s: float) -> list[tuple[str, RunSpec]]:
    duration_s = _duration_s(cycle, longest_s)
    named = [
        (name, default_spec(cycle, duration_s=duration_s, **settings))
        for name, settings in SETTINGS.items()
    ]
    undisturbed, strategy = named[0][1], strategy_by_name(REFERENCE)
    reference = replace(undisturbed, strategy=strategy, horizon=REFERENCE_HORIZON)
    return [*named, (REFERENCE, reference)]


def delay_study(extent: Extent) -> Study:
    """Return the beginning of cycles at several periods with commands delayed by whole ticks."""
    cases = []
    for cycle in extent.lively_cycles:
        duration_s = _duration_s(cycle, extent.delayed_s)
        for period_s in extent.periods_s:
            for ticks in DELAYS:
                faults = lasting((FaultKind.COMMAND_DELAYED, float(ticks))) if ticks else ()
                spec = default_spec(cycle, tick_s=period_s, faults=faults, duration_s=duration_s)
                labels: dict[str, Label] = {"cycle": cycle, "period_s": period_s, "ticks": ticks}
                cases.append(Case(f"{cycle}_{period_s:g}_s_{ticks}", labels, spec))
    return Study("safety_delays", "Delayed commands", "", tuple(cases))


def disturbed_study(extent: Extent) -> Study:
    """Return random trials: what a lead vehicle does, and one or two things that are disturbed."""
    cases = []
    for number in range(1, extent.trials + 1):
        random = np.random.default_rng([extent.seed, number])
        measured = extent.leads and random.random() < MEASURED_SHARE
        cycles = extent.leads if measured else extent.lively_cycles
        cycle = cycles[int(random.integers(len(cycles)))]
        duration_s = _duration_s(cycle, extent.disturbed_s)
        faults, names = _draw(
            random, resolve_inputs(default_spec(cycle, duration_s=duration_s)).route.duration_s
        )
        spec = default_spec(cycle, duration_s=duration_s, faults=faults)
        labels: dict[str, Label] = {"cycle": Path(cycle).stem, "disturbed": names}
        cases.append(Case(f"{number:04d}", labels, spec))
    return Study("safety_trials", "Disturbed trials", "", tuple(cases))


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
    ),
    "brakes": (((FaultKind.BRAKES_WEAK, (0.6, 0.85)),), ((FaultKind.BRAKES_WEAK, (0.85, 1.0)),)),
}
"""What may be disturbed, and the forms of it: kinds with the range of their size."""

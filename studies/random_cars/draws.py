"""Random runs as data: what is drawn, from which distribution, and one generator for each run.

Run i of a seed is the same however many runs are asked for, so that a longer study finds the runs of a
shorter one in its cache. A draw that `iptm.simulate` refuses is repeated: whatever it accepts is a legal car.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from studies.session import Case, inputs_of

from iptm.parts import (
    CYCLE_NAMES,
    STRATEGIES,
    ControllerSettings,
    Fault,
    FaultKind,
    IptmError,
    ModelParameters,
    ScenarioError,
    available_parameter_sets,
    in_order,
    read_yaml,
)

MAX_TRIES = 500
OVERRIDE_SHARE = 0.5
"""Probability that a parameter outside ``ALWAYS`` differs from its set."""
FAULT_SHARE = 0.3
"""Share of the runs in which something goes wrong; cars and trips are the same without."""
MOST_FAULTS = 3
LASTING_SHARE = 0.25
"""Probability that a fault lasts until the end of the trip."""
TOGETHER_SHARE = 0.5
"""Probability that a further fault begins while the one before it lasts."""
IMPERFECT_SHARE = 0.3
"""Share of the runs in which the preview is not perfect; cars and trips are the same without."""
WARM_K = 308.15
TWIN = "warm_twin"
"""Hardly any car occurs twice, and compiling takes longer than some minutes of driving do without."""


Draw = Sequence[float] | Mapping[str, Any]
"""Bounds of a number, or ``values`` of which the ``first`` one has that probability, the others alike."""


def drawn(draw: Draw, random: Generator) -> Any:
    """Return a value; a number between bounds is rounded to three decimals for readability."""
    if not isinstance(draw, Mapping):
        low, high = draw
        return round(float(random.uniform(low, high)), 3)
    values = draw["values"]
    if len(values) == 1 or random.random() < draw["first"]:
        return values[0]
    return values[1 + int(random.integers(len(values) - 1))]


_DEFAULT = ControllerSettings()
_HORIZONS = ("15x1", "3x1+5x5", "8x1", "30x1", "3x1+12x5", "5x1+5x2+4x5", "3x1+3x15")
_OPTIMISING = (name for name, strategy in STRATEGIES.items() if not strategy.is_rule_based)
SETTINGS: Mapping[str, Draw] = {
    "parameter_set": {"values": available_parameter_sets(), "first": 0.4},
    "strategy": {"values": [*dict.fromkeys((_DEFAULT.strategy, *_OPTIMISING))], "first": 0.5},
    "horizon": {"values": [*dict.fromkeys((_DEFAULT.horizon, *_HORIZONS))], "first": 0.4},
    "cycle": {"values": [*CYCLE_NAMES, "smooth"], "first": 1.0 / (1 + len(CYCLE_NAMES))},
    "slope": {"values": ["large", "flat", "small"], "first": 0.4},
    "duration_s": {"values": [600.0, 450.0, 300.0], "first": 0.4},
}
"""What is drawn for every run, by the name of the setting."""

_TABLE: Mapping[str, Mapping[str, Draw]] = read_yaml(
    Path(__file__).parent / "draws.yaml", ScenarioError
)
ALWAYS = _TABLE["always"]
"""Parameters that differ in every run."""
SOMETIMES = _TABLE["sometimes"]
"""Parameters that differ in some runs."""
PREVIEWS = _TABLE["previews"]
"""Settings of a preview that is not perfect; all but the mode differ in every other run."""
FAULT_SIZES = _TABLE["fault_sizes"]
"""Sizes of faults by kind; the other kinds have their usual one."""
ORDINARY = (FaultKind.LEADER_CUT_INS_BY_ROOM, FaultKind.LEADER_CUT_INS_BY_HEADWAY)
"""Kinds that are not drawn: they belong to ordinary traffic."""


def random_cases(
    runs: int,
    seed: int,
    duration_s: float | None = None,
    *,
    with_twins: bool = True,
    fault_share: float = FAULT_SHARE,
    imperfect_share: float = IMPERFECT_SHARE,
) -> list[Case]:
    """Draw trips.

    A trip of the default strategy on a cold day gets a twin: the same car and trip at 35 degC with the
    temperature limits removed, as reference of its traction energy.

    Args:
        runs: number of trips, without the twins.
        seed: seed of all draws.
        duration_s: length of all trips; None for those drawn.
        with_twins: cold trips get their twin.
        fault_share: share of the trips with faults, from 0 to 1.
        imperfect_share: share of the trips with a preview that is not perfect, from 0 to 1.

    Raises:
        ScenarioError: numbers out of range, or no legal car was found.
    """
    if runs < 1:
        raise ScenarioError(f"runs is {runs}; allowed: at least 1")
    if seed < 0:
        raise ScenarioError(f"seed is {seed}; allowed: 0 or more")
    for what, share in (("fault share", fault_share), ("imperfect share", imperfect_share)):
        if not 0.0 <= share <= 1.0:
            raise ScenarioError(f"{what} is {share}; allowed: 0 to 1")
    cases: list[Case] = []
    for number in range(1, runs + 1):
        call, inputs = _draw_run(np.random.default_rng([seed, number]), duration_s)
        # From a generator of their own: with or without faults, a run has the same car and trip.
        faults = np.random.default_rng([seed, number, 1])
        if faults.random() < fault_share:
            call["faults"] = draw_faults(faults, inputs.route.duration_s)
        previews = np.random.default_rng([seed, number, 2])
        if previews.random() < imperfect_share:
            call |= draw_preview(previews)
        name = f"{number:04d}"
        cases.append(Case(name, {"number": number}, call))
        if with_twins and has_twin(inputs.parameters, call["strategy"]):
            cases.append(Case(f"{name}_{TWIN}", {"number": number}, warm_twin(call)))
    return cases


def has_twin(parameters: ModelParameters, strategy: str) -> bool:
    """Return whether a trip has the default strategy, and air or cells begin below the lower limit."""
    environment = parameters.environment
    coldest_k = min(environment.ambient_temperature_k, environment.initial_cell_temperature_k)
    cold = coldest_k < parameters.limits.min_temperature_k
    return cold and strategy == _DEFAULT.strategy


def warm_twin(call: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same trip at 35 degC with the temperature limits taken away."""
    warm = {
        "environment.ambient_temperature_k": WARM_K,
        "environment.initial_cell_temperature_k": WARM_K,
        "limits.min_temperature_k": 253.15,
        "limits.max_temperature_k": 353.15,
    }
    return {**call, "overrides": {**call["overrides"], **warm}}


def draw_preview(random: Generator) -> dict[str, Any]:
    """Return the imperfect preview settings, empty for a perfect preview."""
    return {
        name: drawn(draw, random)
        for name, draw in PREVIEWS.items()
        if name == "preview_mode" or random.random() < OVERRIDE_SHARE
    }


def draw_faults(random: Generator, duration_s: float) -> tuple[Fault, ...]:
    """Return one fault or a few for a trip, of kinds that happen without ROS."""
    kinds = [kind for kind in FaultKind if kind.spec.headless and kind not in ORDINARY]
    faults: list[Fault] = []
    for _ in range(1 + int(random.integers(MOST_FAULTS))):
        kind = kinds[int(random.integers(len(kinds)))]
        sizes = FAULT_SIZES.get(kind)
        earliest_s, latest_s = 0.0, duration_s
        if faults and random.random() < TOGETHER_SHARE:
            earliest_s, latest_s = faults[-1].start_s, min(faults[-1].end_s, duration_s)
        lasting = random.random() < LASTING_SHARE
        faults.append(
            Fault(
                kind,
                start_s=round(float(random.uniform(earliest_s, latest_s))),
                duration_s=duration_s if lasting else round(float(random.uniform(1.0, 30.0))),
                probability=1.0 if random.random() < 0.5 else drawn((0.1, 1.0), random),
                seed=int(random.integers(1000)),
                size=None if sizes is None else drawn(sizes, random),
            )
        )
    return in_order(faults)


def _draw_run(random: Generator, duration_s: float | None) -> tuple[dict[str, Any], Any]:
    """Return the arguments of `iptm.simulate` for a legal trip, and its inputs."""
    settings = {name: drawn(draw, random) for name, draw in SETTINGS.items()}
    settings["vehicle"] = settings.pop("parameter_set")
    if duration_s is not None:
        settings["duration_s"] = duration_s
    for _ in range(MAX_TRIES):
        overrides = {key: drawn(draw, random) for key, draw in ALWAYS.items()}
        for key, draw in SOMETIMES.items():
            if random.random() < OVERRIDE_SHARE:
                overrides[key] = drawn(draw, random)
        call = {**settings, "overrides": overrides, "compile_code": False}
        try:
            return call, inputs_of(call)
        except IptmError as error:
            refusal = str(error)
    raise ScenarioError(
        f"no legal car in {MAX_TRIES} draws with {settings}; the last one: {refusal}"
    )

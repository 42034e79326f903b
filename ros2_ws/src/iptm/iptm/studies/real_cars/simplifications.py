"""What the controller loses by a model that is simpler than the vehicle.

The vehicle has all laws that the measurements ask for. Some of them the controller's model leaves out:
there the loss is that of the shipped controller against one that has them, or has the number that they
would give it. The others it shares with the vehicle: there the loss is that of a controller without
them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from iptm.studies.drives import DEFAULT, PRODUCTION, spec_of
from iptm.studies.real_cars.savings import CYCLE, totals
from iptm.studies.run_spec import RunSpec
from iptm.studies.study import Case, Study
from iptm_core.settings import ThermalModel

CAR = "bmw_i3"
CLIMATES_C = (-10.0, 35.0)
LARGEST_LOSS = 0.5
"""Percentage points of the saving that a simplification may cost."""
LOW_CHARGE = 0.3
NARROW = 0.25

Settings = Mapping[str, Any]
"""Settings of a run (as in `drive`) in which vehicle and controller differ from the shipped ones."""
_MODEL = "controller_overrides"
_OF_THE_CONTROLLER = (_MODEL, "solver")
"""Settings that the controller with which it is compared does not have."""


@dataclass(frozen=True)
class Simplification:
    """A simpler model for comparison with the refined one.

    Attributes:
        name: short name.
        refined_text: the refined law.
        simple_text: what stands in its place.
        simple: vehicle and controller with the simple model.
        refined: with the refined one.
    """

    name: str
    refined_text: str
    simple_text: str
    simple: Settings = field(default_factory=dict)
    refined: Settings = field(default_factory=dict)

    @property
    def shipped(self) -> bool:
        """Whether the shipped controller has the simple model."""
        return _MODEL not in self.simple


def _model(overrides: Mapping[str, float]) -> Settings:
    """Return a controller whose model differs from the vehicle."""
    return {_MODEL: tuple(overrides.items())}


_NO_LIMITS = {"regeneration.torque_nm": 0.0}
_ZETA = "powertrain.regenerative_efficiency"
_LINEAR = {"cell.resistance_exponent_1_k": 0.0}
_NO_AIR = {"cooling.air_exchange_w_k": 0.0}
_NO_DRAG = {"powertrain.drag_loss_w_s2_rad2": 0.0}
_NO_CHARGE = {
    "charge.resistance_slope": 0.0,
    **{f"charge.voltage_share_{percent}": 1.0 for percent in range(0, 101, 10)},
}
_LOW = {"charge.initial_charge": LOW_CHARGE}

SIMPLIFICATIONS = (
    Simplification(
        "charge",
        "open-circuit voltage and resistance at the charge in the middle of the trip (85 %)",
        "at the charge at which the trip begins (90 %)",
        refined=_model({"charge.initial_charge": 0.85}),
    ),
    Simplification(
        "kinks",
        "kinks smoothed over a quarter of the widths",
        "kinks smoothed over the shipped widths",
        refined={"smoothing_factor": NARROW},
    ),
    Simplification(
        "cells",
        "the vehicle has the first and the last cell, too (idealised)",
        "first and last cell for the 12 cells of a coolant channel of the vehicle",
        {"thermal_model": ThermalModel.FULL_CHANNEL},
    ),
    Simplification(
        "resistance",
        "resistance exponential in temperature",
        "linear, -0.8 % per kelvin",
        _model(_LINEAR),
    ),
    Simplification(
        "wrong_charge",
        "open-circuit voltage and resistance at 30 % charge, where this trip begins",
        "at 90 %",
        {"overrides": _LOW, **_model({"charge.initial_charge": 0.9})},
        {"overrides": _LOW},
    ),
    Simplification(
        "constant_voltage",
        "open-circuit voltage and resistance at the charge at which the trip begins",
        "those at half charge, always",
        _model(_NO_CHARGE),
    ),
    Simplification(
        "best_zeta",
        "limits of regeneration, blending with the friction brakes",
        "best constant share, 0.69",
        _model({**_NO_LIMITS, _ZETA: 0.69}),
    ),
    Simplification(
        "papers_zeta",
        "limits of regeneration, blending with the friction brakes",
        "the paper's constant share, 0.3",
        _model({**_NO_LIMITS, _ZETA: 0.3}),
    ),
    Simplification(
        "air",
        "heat exchange of the pack with the air",
        "none",
        _model(_NO_AIR),
    ),
    Simplification(
        "drag",
        "drag loss of the motor",
        "none",
        _model(_NO_DRAG),
    ),
    Simplification(
        "all",
        "all of these laws",
        "none: the paper's equations with the numbers of the car and its 0.3",
        _model({**_LINEAR, **_NO_CHARGE, **_NO_LIMITS, **_NO_AIR, **_NO_DRAG, _ZETA: 0.3}),
    ),
)


_RUNS = (("simple", DEFAULT), ("refined", DEFAULT), ("refined", PRODUCTION))
"""Side and role of the runs of one simplification at one temperature."""


def simplification_study(
    climates_c: Sequence[float] = CLIMATES_C, count: int | None = None
) -> Study:
    """Return all runs that the table of the simplifications needs, or those of the first ones."""
    cases = [
        Case(
            _name(simplification, side, role, ambient_c),
            {"simplification": simplification.name, "ambient_c": ambient_c},
            _spec(getattr(simplification, side), role, ambient_c),
        )
        for simplification in SIMPLIFICATIONS[:count]
        for side, role in _RUNS
        for ambient_c in climates_c
    ]
    return Study(
        "simplifications",
        "Simpler models in the controller",
        "Saving of the default strategy with a simple and with a refined model of the controller.",
        tuple(cases),
    )


def _spec(side: Settings, role: str, ambient_c: float) -> RunSpec:
    """Return a run; a controller with which the default strategy is compared has the shipped model."""
    omitted = () if role == DEFAULT else _OF_THE_CONTROLLER
    settings = {name: value for name, value in side.items() if name not in omitted}
    return spec_of(CYCLE, role, CAR, ambient_c, **settings)


def losses(states: Sequence[Case]) -> pd.DataFrame:
    """Return what simplifications cost, as far as all runs are there.

    Returns:
        A row per ``simplification`` and ``ambient_c``, with the loss in saving in percentage points: of
        capacity loss (``aging``) and of battery energy per distance (``consumption``), both against the
        same run of the production-like controller.
    """
    runs = {state.name: state.metrics for state in states}
    rows = []
    for simplification in SIMPLIFICATIONS:
        for ambient_c in CLIMATES_C:
            found = [runs.get(_name(simplification, *run, ambient_c)) for run in _RUNS]
            there = [totals([run]) for run in found if run is not None]
            if len(there) == len(_RUNS):
                simple, refined, production = there
                row = {"simplification": simplification.name, "ambient_c": ambient_c}
                rows.append(
                    row
                    | {
                        name: 100.0 * (simple[name] - refined[name]) / production[name]
                        for name in ("aging", "consumption")
                    }
                )
    return pd.DataFrame(rows, columns=["simplification", "ambient_c", "aging", "consumption"])


def worst_losses(found: pd.DataFrame) -> dict[str, float]:
    """Return the largest loss in the saving of ageing by simplification, infinite where it was not driven."""
    worst = found.groupby("simplification").aging.max()
    return {each.name: float(worst.get(each.name, math.inf)) for each in SIMPLIFICATIONS}


def too_large(found: pd.DataFrame) -> list[str]:
    """Return the shipped simplifications that cost more than they may."""
    worst = worst_losses(found)
    return [
        each.name for each in SIMPLIFICATIONS if each.shipped and worst[each.name] > LARGEST_LOSS
    ]


def _name(simplification: Simplification, side: str, role: str, ambient_c: float) -> str:
    return f"{simplification.name}/{side}/{role}/{ambient_c:g}"

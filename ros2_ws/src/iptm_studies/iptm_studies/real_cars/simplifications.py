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

import pandas as pd

from iptm_core.settings import ThermalModel
from iptm_studies.campaign import CaseState
from iptm_studies.drives import DEFAULT, PRODUCTION, drive
from iptm_studies.real_cars.savings import CYCLE, Extent, totals
from iptm_studies.run_spec import RunSpec
from iptm_studies.study import Case, Study

CAR = "bmw_i3"
CLIMATES_C = (-10.0, 35.0)
LARGEST_LOSS = 0.5
"""Percentage points of the saving that a simplification may cost."""
LOW_CHARGE = 0.3
NARROW = 0.25

Overrides = Mapping[str, float]


@dataclass(frozen=True)
class Side:
    """A vehicle, and the controller that drives it.

    Attributes:
        vehicle: parameters in which the vehicle differs from the set.
        model: parameters in which the controller's model differs from the vehicle.
        smoothing_factor: on the widths of the smoothed kinks of the model.
        thermal_model: cells that the vehicle has.
    """

    vehicle: Overrides = field(default_factory=dict)
    model: Overrides = field(default_factory=dict)
    smoothing_factor: float = 1.0
    thermal_model: ThermalModel = ThermalModel.TWO_CELL

    def spec(self, role: str, ambient_c: float, extent: Extent) -> RunSpec:
        """Return its run; a controller that it is compared with has the shipped model."""
        shipped = role != DEFAULT
        return drive(
            role,
            CAR,
            ambient_c,
            cycle=CYCLE,
            overrides=self.vehicle,
            controller_overrides=() if shipped else tuple(self.model.items()),
            solver=extent.solver(1.0 if shipped else self.smoothing_factor),
            duration_s=extent.duration_s,
            thermal_model=self.thermal_model,
        )


SHIPPED = Side()


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
    simple: Side
    refined: Side = SHIPPED

    @property
    def shipped(self) -> bool:
        """Whether the shipped controller has the simple model."""
        return not self.simple.model


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
        SHIPPED,
        Side(model={"charge.initial_charge": 0.85}),
    ),
    Simplification(
        "kinks",
        "kinks smoothed over a quarter of the widths",
        "kinks smoothed over the shipped widths",
        SHIPPED,
        Side(smoothing_factor=NARROW),
    ),
    Simplification(
        "cells",
        "the vehicle has the first and the last cell, too (idealised)",
        "first and last cell for the 12 cells of a coolant channel of the vehicle",
        Side(thermal_model=ThermalModel.FULL_CHANNEL),
    ),
    Simplification(
        "resistance",
        "resistance exponential in temperature",
        "linear, -0.8 % per kelvin",
        Side(model=_LINEAR),
    ),
    Simplification(
        "wrong_charge",
        "open-circuit voltage and resistance at 30 % charge, where this trip begins",
        "at 90 %",
        Side(vehicle=_LOW, model={"charge.initial_charge": 0.9}),
        Side(vehicle=_LOW),
    ),
    Simplification(
        "constant_voltage",
        "open-circuit voltage and resistance at the charge at which the trip begins",
        "those at half charge, always",
        Side(model=_NO_CHARGE),
    ),
    Simplification(
        "best_zeta",
        "limits of regeneration, blending with the friction brakes",
        "best constant share, 0.69",
        Side(model={**_NO_LIMITS, _ZETA: 0.69}),
    ),
    Simplification(
        "papers_zeta",
        "limits of regeneration, blending with the friction brakes",
        "the paper's constant share, 0.3",
        Side(model={**_NO_LIMITS, _ZETA: 0.3}),
    ),
    Simplification(
        "air",
        "heat exchange of the pack with the air",
        "none",
        Side(model=_NO_AIR),
    ),
    Simplification(
        "drag",
        "drag loss of the motor",
        "none",
        Side(model=_NO_DRAG),
    ),
    Simplification(
        "all",
        "all of these laws",
        "none: the paper's equations with the numbers of the car and its 0.3",
        Side(model={**_LINEAR, **_NO_CHARGE, **_NO_LIMITS, **_NO_AIR, **_NO_DRAG, _ZETA: 0.3}),
    ),
)


_RUNS = (("simple", DEFAULT), ("refined", DEFAULT), ("refined", PRODUCTION))
"""Side and role of the runs of one simplification at one temperature."""


def simplification_study(extent: Extent) -> Study:
    """Return all runs that the table of the simplifications needs."""
    cases = [
        Case(
            _name(simplification, side, role, ambient_c),
            {"simplification": simplification.name, "ambient_c": ambient_c},
            getattr(simplification, side).spec(role, ambient_c, extent),
        )
        for simplification in SIMPLIFICATIONS[: extent.simplifications]
        for side, role in _RUNS
        for ambient_c in CLIMATES_C
        if ambient_c in extent.climates_c
    ]
    return Study(
        "simplifications",
        "Simpler models in the controller",
        "Saving of the default strategy with a simple and with a refined model of the controller.",
        tuple(cases),
    )


def losses(states: Sequence[CaseState]) -> pd.DataFrame:
    """Return what simplifications cost, as far as all runs are there.

    Returns:
        A row per ``simplification`` and ``ambient_c``, with the loss in saving in percentage points: of
        capacity loss (``aging``) and of battery energy per distance (``consumption``), both against the
        same run of the production-like controller.
    """
    runs = {state.case.name: state.metrics for state in states}
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

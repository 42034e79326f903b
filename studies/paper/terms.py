"""What the project adds to the paper's equations, and each of it taken away alone: the print in its place.

Parameters and settings do it where they can. Elsewhere the standard library's ``patch`` puts what is printed
in the place of a function for the length of a run, which therefore has a process of its own.
"""

from __future__ import annotations

import itertools
import multiprocessing
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from studies.paper import figures, statements, trips
from studies.paper.equations import Array

STAGE, GRID = "iptm_controller.ocp.stages", "iptm_controller.ocp.grid"
RUNS = {
    "reference": trips.CONTROLLERS["reference"],
    "energy_aging": trips.weights()["energy_aging"][-1],
    "aging": trips.CONTROLLERS["aging"],
}
SHOWN = (
    "cooling_energy",
    "traction_energy_battery",
    "battery_energy",
    "cell_1_degradation",
    "inconsistency",
)
TITLES = {"aging": "SH 15 aging", "energy_aging": "vice benchmark"}
DURATION_S = 1200.0
"""NYCC, and the first third of WLTC: as long as it takes to see a difference."""
WHOLE = ", whole trip"
"""Of the terms that need no patch, and so no interpreted solver."""


def one_sample(_: int) -> tuple[Array, Array]:
    """The Euler step: one sample, at the start of a step, with all the weight."""
    return np.zeros(1), np.ones(1)


def without_vertex(_: Any) -> float:
    """The parabola of eq. (14) as it is."""
    return float("inf")


def map_as_it_is(line: Any, outlet_k: Any, smoothing_w: float = 0.0) -> Any:  # noqa: ARG001
    """Cooling rate of eq. (14), negative where the map is."""
    return line.gate * (line.offset_w + line.slope_w_k * (outlet_k - figures.CELSIUS_ZERO_K))


def always_released(*_: Any, **__: Any) -> float:
    """Motor torque at standstill, too: eqs. (2) and (3) hold the car on a hill."""
    return 1.0


def no_reserve(gap_m: Any, *_: Any) -> Any:
    """A row that always holds."""
    return 0.0 * gap_m + 1.0


def euler_position(position_m: Any, speed_m_s: Any, _: Any, duration_s: float) -> Any:
    """Eq. (1) by one Euler step."""
    return position_m + duration_s * speed_m_s


@dataclass(frozen=True)
class Term:
    """A term that the project adds.

    Attributes:
        added: what the project does.
        printed: what is printed, and driven here.
        settings: of `iptm.simulate` that do it.
        patches: objects by the dotted name in whose place they stand.
    """

    added: str
    printed: str
    settings: trips.Settings = field(default_factory=dict)
    patches: Mapping[str, Any] = field(default_factory=dict)


TERMS = {
    "gate": Term(
        "gate of the chiller map", "eq. (14) without", {"overrides": {"chiller.gate_power_w": 0.0}}
    ),
    "bound": Term(
        "max(map, 0)",
        "a map that may heat",
        patches={"iptm_core.physics.chiller.ChillerLine.cooling_rate_w": map_as_it_is},
    ),
    "vertex": Term(
        "map held beyond its vertex",
        "the whole parabola",
        patches={"iptm_core.physics.chiller._vertex_w": without_vertex},
    ),
    "hold": Term(
        "brakes hold at standstill",
        "motor torque at standstill",
        patches={"iptm_core.physics.power_thermal.brake_release": always_released},
    ),
    "reserve": Term(
        "braking reserve at the end of the preview",
        "none",
        patches={f"{STAGE}.braking_reserve_m": no_reserve},
    ),
    "cold": Term(
        "lower temperature limit as a low price",
        "a limit like the upper one",
        patches={
            "iptm_controller.ocp.stage.COLD_PRICE_1_K_S": 200.0,
            "iptm_controller.ocp.stage.COLD_PRICE_SHARE_1_S": 0.0,
        },
    ),
    "signed": Term(
        "magnitude of the C-rate in eq. (12)",
        "signed, so that fast charging ages less",
        {"overrides": {"aging.charging_rate_factor": -1.0}},
    ),
    "efficiency": Term(
        "η_b = 1, as the loss is in R_b",
        "η_b < 1, no value printed: 0.95",
        {"overrides": {"pack.battery_efficiency": 0.95}},
    ),
    "smoothing": Term("smoothed kinks", "a tenth of the widths", {"smoothing_factor": 0.1}),
    "step": Term(
        "motion exact, powers by quadrature in a step",
        "one Euler step of 1 to 15 s",
        patches={
            f"{GRID}.sample_count": lambda _: 1,
            f"{GRID}.quadrature": one_sample,
            f"{STAGE}.quadrature": one_sample,
            f"{STAGE}.advance_position_m": euler_position,
            f"{STAGE}.LONGEST_STEP_WITHOUT_SAMPLED_GAP_S": float("inf"),
        },
    ),
}


def drive(patched: str = "", **settings: Any) -> dict[str, Any]:
    """Drive a trip with the print in the place of a term, in a process that ends with the trip."""
    if not patched:
        return figures.drive(**settings)
    with multiprocessing.get_context("spawn").Pool(1) as process:
        return process.apply(_drive_patched, (patched, settings))


def _drive_patched(name: str, settings: trips.Settings) -> dict[str, Any]:
    with ExitStack() as stack:
        for place, printed in TERMS[name].patches.items():
            stack.enter_context(patch(place, printed))
        return figures.drive(**settings)


def calls(short: bool) -> dict[str, trips.Settings]:  # noqa: FBT001
    """Arguments of `drive` by term and run: none of the terms, then each alone, with each of `RUNS`."""
    found: dict[str, trips.Settings] = {}
    whole: dict[str, trips.Settings] = {}
    for name, (run, driver) in itertools.product(
        ("", *list(TERMS)[: 1 if short else None]), RUNS.items()
    ):
        settings = trips.merged(driver, TERMS[name].settings) if name else driver
        # A process of its own would compile its problem for this one trip.
        patched = {"patched": name, "compile_code": False} if name and TERMS[name].patches else {}
        trip = trips.complete(settings, short=short)
        found[f"{name}/{run}"] = {"duration_s": DURATION_S, **trip, **patched}
        if not patched and not short:
            whole[f"{name}{WHOLE}/{run}"] = trip
    return found | whole


def table(done: Mapping[str, dict[str, Any]]) -> pd.DataFrame:
    """A row per term: changes of two controllers against the reference under the same model, in percent."""
    rows = []
    for name in dict.fromkeys(address.partition("/")[0] for address in done):
        term = TERMS.get(name.removesuffix(WHOLE), Term("all of them", "–"))
        extent = WHOLE if name.endswith(WHOLE) else ""
        row = {"the project": f"{term.added}{extent}", "as printed": term.printed}
        driven = {run: done[key] for run in RUNS if (key := f"{name}/{run}") in done}
        if len(driven) < len(RUNS):
            rows.append(row | {"SH 15 aging": "a run failed"})
            continue
        found = pd.DataFrame({run: each["figures"] for run, each in driven.items()}).T
        for run, title in TITLES.items():
            changes = [statements.changes(found, [run], "reference", key)[0] for key in SHOWN]
            row[title] = " / ".join(f"{change:+.1f}" for change in changes)
        reference, settled = found.loc["reference"], found.settled_temperature
        energies = reference.cooling_energy, reference.traction_energy_battery
        row["reference [kJ]"] = " / ".join(f"{energy:.0f}" for energy in energies)
        row["cells, aging / vice [°C]"] = f"{settled.aging:.1f} / {settled.energy_aging:.1f}"
        rows.append(row)
    return pd.DataFrame(rows).fillna("–")

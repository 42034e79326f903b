"""The paper's studies driven again, its statements checked, and the page that says so.

Every set of parameters drives the 53 runs of the paper; with ``--beyond`` the studies beyond it are driven
with the first set, for a page of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from studies.paper import checks, equations, figures, page, trips

import iptm

HERE = Path(__file__).parent
SETS: dict[str, tuple[trips.Settings, float]] = {
    "gated": ({"overrides": {trips.LARGEST_GAP: 200.0}}, trips.FULL_COST_WEIGHT_1_J),
    "as_printed": (
        {
            "vehicle": str(HERE / "as_printed.yaml"),
            "overrides": {"chiller.gate_power_w": 0.0},
        },
        1e-5,
    ),
}
"""Settings of the reproduction, and lambda_P of J1-4: with the added physics, and as printed."""


SHORT_GRIDS = ("15x1", "3x1+5x5")
"""Grids of the short form; the others take minutes to build."""


def run(session: Any) -> bool:
    """Drive, check, and write the page; the short version drives those on two grids for some seconds."""
    found = {name: paper(session, name, *given) for name, given in SETS.items()}
    tables = {name: table(runs) for name, runs in found.items()}
    verdicts = {name: checks.all_checks(each) for name, each in tables.items()}
    regeneration = page.regeneration(table(drive(session, trips.regeneration_runs())))
    widened = {name: gaps(session, name, given) for name, (given, _) in SETS.items()}
    parts = page.parts(found, tables, verdicts)
    session.render(
        **parts,
        gaps=page.gaps(widened),
        largest_gap={name: largest_gap_m(given) for name, (given, _) in SETS.items()},
        regeneration=regeneration,
    )
    page.draw(session.output / "pictures", found, tables)
    if session.options.beyond:
        shipped = paper(session, "as shipped", {}, trips.FULL_COST_WEIGHT_1_J)
        more = {**shipped, **drive(session, trips.further_runs())}
        session.render("beyond.md.j2", "beyond.md", **page.beyond(table(more)))
    return not session.failures


def drive(session: Any, runs: Mapping[str, trips.Settings], prefix: str = "") -> dict[str, Any]:
    """Return what `figures.drive` keeps of each run by address; equal settings are driven once."""
    calls: list[trips.Settings] = []
    names: list[str] = []
    places: dict[str, int] = {}
    for address, settings in runs.items():
        if session.short and settings["horizon"] not in SHORT_GRIDS:
            continue
        call = trips.complete(settings, short=session.short)
        if call not in calls:
            calls.append(call)
            names.append(prefix + address)
        places[address] = calls.index(call)
    done = session.compute(figures.drive, calls, names)
    return {address: done[place] for address, place in places.items() if done[place] is not None}


def paper(session: Any, name: str, given: trips.Settings, full_cost_1_j: float) -> dict[str, Any]:
    """The paper's studies with some settings; the weights of its Table IV are the best of each strategy."""
    plan = trips.paper_runs(full_cost_1_j)
    runs = drive(session, {a: trips.merged(each, given) for a, each in plan.items()}, f"{name}: ")
    degradation = {address: each["figures"]["total_degradation"] for address, each in runs.items()}
    for strategy in trips.WEIGHTED:
        runs[f"strategies/{strategy}"] = runs[trips.best_weight(strategy, degradation)]
    return runs


def gaps(session: Any, name: str, given: trips.Settings) -> dict[float, pd.DataFrame]:
    """Figures of the benchmark, SH 15 and MH 3+5 with some settings, by the largest gap in m."""
    found = {}
    for gap_m in trips.LARGEST_GAPS_M[: 1 if session.short else None]:
        wider = trips.merged(given, {"overrides": {trips.LARGEST_GAP: gap_m}})
        runs = {a: trips.merged(each, wider) for a, each in trips.gap_runs().items()}
        found[gap_m] = table(drive(session, runs, f"{name}, {gap_m:g} m: "))
    return found


def largest_gap_m(given: trips.Settings) -> float:
    """The largest gap with some settings."""
    loaded = iptm.load_parameters(given.get("vehicle", trips.VEHICLE), given.get("overrides", {}))
    return float(loaded.values.gap.max_gap_m)


def table(runs: Mapping[str, Any]) -> pd.DataFrame:
    """Figures of runs, a row per address.

    The shares of time at low and high power are relative to the reference of Table IV.
    """
    found = pd.DataFrame({address: run["figures"] for address, run in runs.items()}).T
    reference = runs.get("strategies/reference")
    if reference is not None:
        bounds = figures.power_bounds_kw(reference["frame"])
        for address in found.index[found.index.str.startswith("strategies/")]:
            for key, value in figures.power_shares(runs[address]["frame"], bounds).items():
                found.loc[address, key] = value
    found.attrs["aging_map"] = equations.aging_map(iptm.load_parameters(trips.VEHICLE).values)
    return found

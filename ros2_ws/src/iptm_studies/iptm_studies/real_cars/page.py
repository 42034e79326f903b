"""The page about real cars: savings, and what simpler models of the controller cost."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from iptm_core.markdown import render_page, table_of
from iptm_core.parameters import load_parameters
from iptm_studies.real_cars.savings import Extent
from iptm_studies.real_cars.simplifications import (
    CAR,
    LARGEST_LOSS,
    SIMPLIFICATIONS,
    worst_losses,
)


def real_cars_page(
    command: str,
    extent: Extent,
    cycle: pd.DataFrame,
    road: pd.DataFrame,
    losses: pd.DataFrame,
    failures: Mapping[str, str],
    lacking: int = 0,
) -> str:
    """Return the page as Markdown.

    Args:
        command: what makes it.
        extent: what was driven.
        cycle: savings on the cycle.
        road: savings on the measured trips.
        losses: losses by simplification and temperature.
        failures: failed runs, address and cause.
        lacking: number of runs that are not stored yet.
    """
    sets = {car: load_parameters(car) for car in extent.cars}
    return render_page(
        "iptm_studies.real_cars",
        "real_cars.md.j2",
        command=command,
        cars=[
            {"car": car, "about": one.description, "mass_kg": one.values.body.mass_kg}
            for car, one in sets.items()
        ],
        cycle=cycle,
        road=road,
        trips=len(extent.trips),
        car=CAR,
        largest_loss=LARGEST_LOSS,
        shipped=_losses(losses, shipped=True),
        shared=_losses(losses, shipped=False),
        failures=[{"run": run, "cause": cause} for run, cause in failures.items()],
        lacking=lacking,
    )


def _losses(losses: pd.DataFrame, *, shipped: bool) -> str:
    """Return the table of the simplifications that the shipped controller has, or of the others."""
    climates = sorted(losses.ambient_c.unique())
    worst = worst_losses(losses)
    rows = []
    for each in SIMPLIFICATIONS:
        if each.shipped == shipped:
            row: dict[str, str | None] = {"simple": each.simple_text, "refined": each.refined_text}
            row |= {f"at {celsius:g}": None for celsius in climates}
            for loss in losses[losses.simplification == each.name].itertuples():
                values = (round(value, 2) + 0.0 for value in (loss.aging, loss.consumption))
                row[f"at {loss.ambient_c:g}"] = " / ".join(f"{value:+.2f}" for value in values)
            row["bar"] = "within" if worst[each.name] <= LARGEST_LOSS else "**beyond**"
            rows.append(row)
    heads = {"simple": "{simple}", "refined": "{refined}"}
    heads |= {f"{celsius:g} °C:": f"{{at {celsius:g}}}" for celsius in climates}
    return table_of(rows, heads | {"bar": "{bar}"})

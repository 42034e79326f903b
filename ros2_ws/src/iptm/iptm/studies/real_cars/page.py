"""The page about real cars: savings, and what simpler models of the controller cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from iptm.studies.real_cars.simplifications import (
    CAR,
    LARGEST_LOSS,
    SIMPLIFICATIONS,
    worst_losses,
)
from iptm_core.markdown import render_page, table_of
from iptm_core.parameters import load_parameters


def real_cars_page(
    command: str,
    cars: Sequence[str],
    trips: int,
    cycle: pd.DataFrame,
    road: pd.DataFrame,
    losses: pd.DataFrame,
    failures: Mapping[str, str],
    lacking: int = 0,
) -> str:
    """Return the page as Markdown.

    Args:
        command: what makes it.
        cars: parameter sets that were driven.
        trips: number of measured trips.
        cycle: savings on the cycle.
        road: savings on the measured trips.
        losses: losses by simplification and temperature.
        failures: failed runs, address and cause.
        lacking: number of runs that are not stored yet.
    """
    sets = {car: load_parameters(car) for car in cars}
    return render_page(
        "iptm.studies.real_cars",
        "real_cars.md.j2",
        command=command,
        cars=[
            {"car": car, "about": one.description, "mass_kg": one.values.body.mass_kg}
            for car, one in sets.items()
        ],
        cycle=cycle,
        road=road,
        trips=trips,
        car=CAR,
        largest_loss=LARGEST_LOSS,
        shipped=_losses(losses, shipped=True),
        shared=_losses(losses, shipped=False),
        failures=[{"run": run, "cause": cause} for run, cause in failures.items()],
        lacking=lacking,
    )


def _losses(losses: pd.DataFrame, *, shipped: bool) -> str:
    """Return the table of the simplifications that the shipped controller has, or of the others."""
    worst = worst_losses(losses)
    texts = [
        " / ".join(f"{round(value, 2) + 0.0:+.2f}" for value in pair)
        for pair in zip(losses.aging, losses.consumption, strict=True)
    ]
    wide = losses.assign(text=texts).pivot(
        index="simplification", columns="ambient_c", values="text"
    )
    columns = {f"{celsius:g} °C:": f"{{at {celsius:g}}}" for celsius in wide}
    wide = wide.rename(columns="at {:g}".format)
    rows = [
        {
            "simple": each.simple_text,
            "refined": each.refined_text,
            "bar": "within" if worst[each.name] <= LARGEST_LOSS else "**beyond**",
            **(wide.loc[each.name] if each.name in wide.index else dict.fromkeys(wide)),
        }
        for each in SIMPLIFICATIONS
        if each.shipped == shipped
    ]
    heads = {"simple": "{simple}", "refined": "{refined}"}
    return table_of(rows, heads | columns | {"bar": "{bar}"})

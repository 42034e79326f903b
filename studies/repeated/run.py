"""The same savings with equal ends, and of the trip driven over and over until the pack settles.

Six level cycles at the headway of `production`. Tables of other studies state equal ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from studies.road_space.run import DEFAULT, DESIRED_S, EQUAL
from studies.savings import PREVIEWS, PRODUCTION, saved
from studies.session import Case, Session

from iptm.repetition import CLOSED, repeat
from iptm_core.metrics.repeated import Repeated
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.routes.cycles import CYCLE_NAMES

PRICES = "prices"
NONE = {"preview_mode": "none"}
CONTROLS: dict[tuple[str, bool], dict[str, Any]] = {
    (PRODUCTION, False): {"strategy": PRODUCTION, **NONE},
    (DEFAULT, True): EQUAL,
    (DEFAULT, False): {**EQUAL, **NONE},
    (PRICES, True): {**EQUAL, "strategy": PRICES},
}
"""Arguments of the trips by control, and whether it has a preview."""
SHORT_CYCLES, SHORT_S = ("us06",), 60.0


def run(session: Session) -> bool:
    """Run the study; returns whether every trip was driven."""
    cases = [
        Case(
            f"{cycle}/{control}/{PREVIEWS[perfect]}",
            {"cycle": cycle, "control": control, "perfect": perfect},
            {"cycle": cycle, **call},
        )
        for cycle in (SHORT_CYCLES if session.short else CYCLE_NAMES)
        for (control, perfect), call in CONTROLS.items()
    ]
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    driven = driven[driven.run.notna()]
    calls = [{"run": each} for each in driven.run]
    driven["repeated"] = session.compute(repeat, calls, [*driven.case + ", repeated"])
    table = pd.DataFrame(
        row for _, trips in driven.groupby("cycle", sort=False) for row in _rows(trips)
    )
    of_control = table.groupby(["control", "preview"], sort=False)
    session.render(
        table=table,
        medians=of_control.median(numeric_only=True).reset_index(),
        unsettled=driven.case[~driven.repeated.map(has_settled)].tolist(),
        repetitions=_extent(driven[driven.repeated.notna()]),
        desired_s=DESIRED_S,
    )
    return len(driven) == len(cases)


def has_settled(repeated: Repeated | None) -> bool:
    """Return whether further repetitions would have the same figures."""
    return repeated is not None and max(repeated.energy_error, repeated.aging_error) < CLOSED


def _rows(trips: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the savings of the trips of a cycle against `production`, in percent."""
    base = next(trips[trips.control == PRODUCTION].itertuples(), None)
    for each in trips[trips.control != PRODUCTION].itertuples():
        if base is not None:
            yield {
                "cycle": each.cycle,
                "control": each.control,
                "preview": PREVIEWS[bool(each.perfect)],
                **saved([each.metrics], [base.metrics], each.run.parameters),
                **_repeated(each.repeated, base.repeated),
            }


def _repeated(own: Repeated | None, base: Repeated | None) -> dict[str, float]:
    """Return what a repetition saves of energy, of ageing by the paper's law, and by the median of cells.

    NaN where one of the packs has not settled.
    """
    names = "repeated_energy", "repeated_ageing", "repeated_cells"
    if own is None or base is None or not (has_settled(own) and has_settled(base)):
        return dict.fromkeys(names, math.nan)
    cells = [saved_percent(lost, base.cell_losses[name]) for name, lost in own.cell_losses.items()]
    figures = (
        saved_percent(own.energy_per_distance_j_m, base.energy_per_distance_j_m),
        saved_percent(own.capacity_loss, base.capacity_loss),
        float(np.median(cells)),
    )
    return dict(zip(names, figures, strict=True))


def _extent(driven: pd.DataFrame) -> dict[str, tuple[int, int]]:
    """Return the fewest and the most repetitions by control."""
    counts = driven.repeated.map(lambda each: each.repetitions).groupby(driven.control)
    return {str(control): (int(each.min()), int(each.max())) for control, each in counts}

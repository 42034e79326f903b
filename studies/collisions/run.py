"""Collisions: families of wrong sensors, messages, cars, roads and processes, and the cases of UN R157."""

from __future__ import annotations

import pandas as pd
from studies.collisions.family_trials import (
    AUTHENTICATED,
    HEADWAYS,
    NO_RADIO,
    RADIOS,
    SEEDS,
    blind_summary,
    broken,
    family_outcomes,
    left_over,
    summary,
)
from studies.collisions.options import STRIDE, TRIALS
from studies.collisions.r157 import outcomes
from studies.collisions.r157 import summary as r157_summary
from studies.measured_cycles import lead_cycles
from studies.session import Session

from iptm_core.routes.cycles import CYCLE_NAMES

SHORT_STRIDE, SHORT_TRIALS, SHORT_HEADWAYS = 24, 1, ("1.5 s",)
PARTS = 24
"""Calls that the grids are split into."""


def run(session: Session) -> bool:
    """Run the study; returns whether everything held."""
    options, short = session.options, session.short
    trials = options.trials or (SHORT_TRIALS if short else TRIALS)
    drives = list(CYCLE_NAMES)
    if not short:
        drives += lead_cycles(session.scratch / "leads")
    families = family_outcomes(
        session,
        drives,
        trials,
        SEEDS[:1] if short else SEEDS,
        SHORT_HEADWAYS if short else tuple(HEADWAYS),
        (AUTHENTICATED, NO_RADIO) if short else RADIOS,
    )
    stride, parts = options.stride or (SHORT_STRIDE if short else STRIDE), 1 if short else PARTS
    calls = [{"stride": stride, "part": part, "parts": parts} for part in range(parts)]
    names = [f"UN R157, part {part + 1} of {parts}" for part in range(parts)]
    tables = [table for table in session.compute(outcomes, calls, names) if table is not None]
    r157 = r157_summary(pd.concat(tables, ignore_index=True))
    lines = broken(families)
    lines += [
        f"UN R157, {row.kind}: {row.unexplained} collisions that a driver avoids"
        for row in r157.itertuples()
        if row.unexplained
    ]
    for line in lines:
        print(line)
    session.say(f"{len(lines)} did not hold")
    session.render(
        trials=len(families),
        families=summary(families),
        blind=blind_summary(families),
        left_over=left_over(families),
        r157=r157,
        stride=stride,
        broken=lines,
    )
    return not lines

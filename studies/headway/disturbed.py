"""Random disturbed trials of the study `safety` at the headways of production cars."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd
from studies.judged import Judged
from studies.measured_cycles import lead_cycles
from studies.safety.judging import AVOIDABLE
from studies.safety.run import judged_runs
from studies.safety.trials import CYCLES, DISTURBED_S, disturbed_cases
from studies.session import Case, Session

TRIALS, SEED = 200, 1
SHORT_TRIALS, SHORT_S = 2, 40.0


def disturbed_trials(
    session: Session, settings: Mapping[str, Mapping[str, Any]]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return a row per setting (trials, collisions, smallest gap, other problems), and one per collision.

    Every setting is driven through the same trials, with the preview that each of them has.

    Args:
        session: of the study.
        settings: arguments of the trips, by name.
    """
    count, longest_s = (SHORT_TRIALS, SHORT_S) if session.short else (TRIALS, DISTURBED_S)
    leads: Sequence[str] = [] if session.short else lead_cycles(session.scratch / "leads")
    trials = disturbed_cases(count, SEED, CYCLES, leads, longest_s)
    rows: list[dict[str, Any]] = []
    collisions: list[dict[str, Any]] = []
    for name, own in settings.items():
        cases = list(_with(trials, name, own))
        if session.short:
            cases = [case.shortened(SHORT_S) for case in cases]
        judged = judged_runs(cases, session.drive(cases), session)
        rows.append({"setting": name, **_counted(judged)})
        collisions += [
            {
                "setting": name,
                "what": trial.what,
                "avoidable": "yes" if AVOIDABLE in trial.problems else "no",
            }
            | dict(trial.figures)
            for trial in judged
            if "bound_m" in trial.figures
        ]
    return pd.DataFrame(rows), pd.DataFrame(collisions)


def _with(trials: Sequence[Case], name: str, own: Mapping[str, Any]) -> Iterator[Case]:
    """Yield trials with the arguments of a setting."""
    for case in trials:
        overrides = {**case.call.get("overrides", {}), **own.get("overrides", {})}
        call = {**case.call, **own, "overrides": overrides}
        yield replace(case, name=f"{name}/{case.name}", call=call)


def _counted(trials: Sequence[Judged]) -> dict[str, float]:
    """Return the figures of a setting."""
    figures = [trial.figures for trial in trials if trial.figures]
    avoidable = sum(AVOIDABLE in trial.problems for trial in trials)
    collided = sum("bound_m" in found for found in figures)
    unavoidable = sum(found.get("bound_m", 1.0) <= 0.0 for found in figures)
    return {
        "trials": len(trials),
        "failed": len(trials) - len(figures),
        "avoidable": avoidable,
        "with_weak_brakes": collided - avoidable - unavoidable,
        "unavoidable": unavoidable,
        "smallest_gap_m": min((found["smallest_gap_m"] for found in figures), default=math.nan),
        "weak": sum("weak" in trial.problems for trial in trials),
        "unreported": sum("report" in trial.problems for trial in trials),
    }

"""What is saved at equal road space: against a car of today, and against a strong baseline without V2X.

A long distance saves by itself, and perfect foresight is no radio. So each saving stands beside the distance
that it takes and the preview that it needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.scenes import LONGEST_S, SCENES, SHORTEST_S, measured_scenes
from studies.session import Case, Session

import iptm
from iptm.parts import CYCLE_NAMES, DEFAULT_SET, at_equal_end, gap_margins_m, load_parameters

CYCLES = ("wltc_class3b", "us06", "hwfet")
TUNED_ON = ("udds", "sc03", "nycc")
"""Of the strong baseline; not in the table of savings."""
PRODUCTION, BASELINE, DEFAULT, REFERENCE = "production", "eco_acc", "default", "reference"
HEADWAY = "gap.max_time_headway_s"
MOVING_M_S = 5.0
"""Headways count above this speed."""
CAR_LENGTH_M = 4.5
BELOW_S_MIN_M = 0.05
SHORT_S = 60.0


def drives() -> list[tuple[str, bool, str, Mapping[str, Any]]]:
    """Return name, preview, limit of the distance, and settings of each row, the bases first."""
    none = {"preview_mode": "none"}
    single = {"strategy": REFERENCE, "horizon": "15x1"}
    rows: list[tuple[str, bool, str, Mapping[str, Any]]] = [
        (PRODUCTION, False, "1.6 s", {"strategy": PRODUCTION, **none}),
        (BASELINE, False, "3.5 s", {"strategy": BASELINE, **none}),
    ]
    for preview, headway_s in product((False, True), (2.0, 3.0)):
        settings = {"overrides": {HEADWAY: headway_s}, **({} if preview else none)}
        rows.append((DEFAULT, preview, f"at most {headway_s:g} s", settings))
    return [
        *rows,
        (DEFAULT, False, "120 m", none),
        (REFERENCE, True, "120 m", single),
        (DEFAULT, True, "120 m", {}),
    ]


def road_space(run: iptm.Run) -> dict[str, float]:
    """Return mean gap in m, median headway in s, and vehicles per hour and lane at that speed and gap."""
    frame = run.frame
    moving = frame[frame.speed_m_s > MOVING_M_S]
    spacing_m = frame.gap_m.mean() + CAR_LENGTH_M
    return {
        "gap_m": frame.gap_m.mean(),
        "headway_s": float(np.median(moving.gap_m / moving.speed_m_s)) if len(moving) else np.nan,
        "vehicles_h": 3600.0 * frame.speed_m_s.mean() / spacing_m,
    }


def saved(run: iptm.Run, base: iptm.Run) -> tuple[float, float]:
    """Return ageing and energy per distance saved in percent, both runs brought to one end."""
    figures = at_equal_end(run.metrics, base.metrics, load_parameters(DEFAULT_SET).values)
    if figures is None:
        return np.nan, np.nan
    own, other = figures
    ageing = 1.0 - own.capacity_loss / other.capacity_loss
    energy = 1.0 - own.energy_per_distance_j_m / other.energy_per_distance_j_m
    return 100.0 * ageing, 100.0 * energy


def following(run: iptm.Run) -> dict[str, float]:
    """Return how a run kept its distance: smallest margin above s_min, seconds below it, smallest gap."""
    margins_m = gap_margins_m(run.trajectory, load_parameters(DEFAULT_SET).values)
    return {
        "margin_m": float(np.min(margins_m)),
        "below_s": int(np.sum(margins_m < -BELOW_S_MIN_M)),
        "smallest_gap_m": float(run.frame.gap_m.min()),
        "interventions": float(run.metrics.interventions),
    }


def run(session: Session) -> bool:
    """Run the study; returns whether the strong baseline touched no lead vehicle."""
    cycles = CYCLES[:1] if session.short else CYCLES
    chosen = drives()
    cases = [
        Case(
            f"{cycle}/{number}",
            {"cycle": cycle, "strategy": name, "preview": preview, "distance": distance},
            {"cycle": cycle, **settings},
        )
        for cycle in cycles
        for number, (name, preview, distance, settings) in enumerate(chosen)
    ]
    leaders = _leader_cases(session)
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
        leaders = [case.shortened(SHORT_S) for case in leaders]
    driven = session.drive([*cases, *leaders])
    table = [
        row
        for _, group in driven[: len(cases)].groupby("cycle", sort=False)
        for row in _rows(group)
    ]
    kept = _kept(driven[len(cases) :])
    session.render(
        savings=_savings(table),
        kept=kept,
        leaders=len({case.labels["cycle"] for case in leaders}),
        tuned_on=", ".join(TUNED_ON),
        car_length_m=CAR_LENGTH_M,
        moving_m_s=MOVING_M_S,
    )
    return bool((kept.smallest_gap_m > 0.0).all())


def _leader_cases(session: Session) -> list[Case]:
    """Return the trips behind every cycle and the measured leaders, of both controls without preview."""
    extent = (1, SHORTEST_S) if session.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(None, session.say, *extent)
    trips = {name: {"cycle": name} for name in CYCLE_NAMES if not session.short} | {
        scene.name: {
            "cycle": scene.write(session.scratch / "leads"),
            "duration_s": float(scene.duration_s),
        }
        for scene in scenes
    }
    none = {"preview_mode": "none"}
    strategies = {
        BASELINE: {"strategy": BASELINE},
        PRODUCTION: {"strategy": PRODUCTION},
        DEFAULT: {},
    }
    return [
        Case(
            f"{leader}/{strategy}",
            {
                "cycle": leader,
                "strategy": strategy,
                "kind": "cycle" if leader in CYCLE_NAMES else "measured",
            },
            {**trip, **settings, **none},
        )
        for leader, trip in trips.items()
        for strategy, settings in strategies.items()
    ]


def _rows(group: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a cycle."""
    if group.run.isna().any():
        return []
    production, baseline = group.run.iloc[0], group.run.iloc[1]
    rows = []
    for each in group.itertuples():
        against = saved(each.run, production), saved(each.run, baseline)
        rows.append(
            {
                "cycle": each.cycle,
                "strategy": each.strategy,
                "preview": "60 s, perfect" if each.preview else "none",
                "distance": each.distance,
                **road_space(each.run),
                **following(each.run),
                "against_production": against[0],
                "against_baseline": against[1],
            }
        )
    return rows


def _savings(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the front table as Markdown."""
    heads = (
        "cycle",
        "control",
        "distance",
        "preview",
        "mean gap",
        "headway",
        "vehicles/(h lane)",
        "ageing saved",
        "energy saved",
        "against `eco_acc`",
    )
    lines = [f"| {' | '.join(heads)} |", "|---|---|---|---|---:|---:|---:|---:|---:|---:|"]
    for row in rows:
        ageing, energy = row["against_production"]
        own, less = row["against_baseline"]
        is_base = row["strategy"] == PRODUCTION
        base = "0, by definition" if is_base else f"{ageing:.1f} %"
        lines.append(
            f"| {row['cycle']} | `{row['strategy']}` | {row['distance']} | {row['preview']} "
            f"| {row['gap_m']:.1f} m | {row['headway_s']:.2f} s | {row['vehicles_h']:.0f} | {base} "
            f"| {'0' if is_base else f'{energy:.1f} %'} | {own:.1f} / {less:.1f} % |"
        )
    return "\n".join(lines)


def _kept(driven: pd.DataFrame) -> pd.DataFrame:
    """Return how each control kept its distance behind cycles and behind measured leaders."""
    found = [
        {"strategy": each.strategy, "kind": each.kind, **following(each.run)}
        for each in driven.itertuples()
        if each.run is not None
    ]
    groups = pd.DataFrame(found).groupby(["kind", "strategy"], sort=False)
    return groups.agg(
        trips=("margin_m", "size"),
        margin_m=("margin_m", "min"),
        below_s=("below_s", "sum"),
        smallest_gap_m=("smallest_gap_m", "min"),
        interventions=("interventions", "sum"),
    ).reset_index()

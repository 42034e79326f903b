"""What judges of ageing make of the same trips: the paper's law, measured cells, BLAST-Lite and PyBaMM.

Also what the savings are made of, the current of one run at the temperatures of the other, a parked pack, and
years of use by the laws of the same cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from studies.road_space.run import EQUAL, SHORT_S
from studies.savings import PRODUCTION
from studies.session import Case, Session

import iptm
from iptm.judging import CURRENT, SAVED, TEMPERATURE, judge_groups
from iptm_core.aging_laws.judging import CELLS, Exposure, Judge
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K
from iptm_life.life import life

CYCLES = ("wltc_class3b", "us06", "hwfet", "udds")
BLAST = "BLAST-Lite"
BY_CELLS, BY_ALL = ("paper", "cells", "blast"), ("paper", "cells", "blast", "pybamm")
JUDGED_BY_ALL = CYCLES[:2]
"""Cycles on which PyBaMM judges, too: a minute for each run."""
PREVIEW, BLIND = "60 s preview", "none"
PARKED_C, PARKED_S = (25.0, 35.0), 1800
CLIMATE, USAGE, LIFE_CELLS = "Phoenix", "taxi", ("NCA",)
"""Of the years of use: each cell takes a dozen trips."""


def run(session: Session) -> bool:
    """Run the study; returns whether every judge had a figure."""
    blind = {"preview_mode": "none"}
    controls: dict[str, dict[str, Any]] = {
        PRODUCTION: {"strategy": PRODUCTION, **blind},
        PREVIEW: EQUAL,
        BLIND: {**EQUAL, **blind},
    }
    cycles = CYCLES[1:2] if session.short else CYCLES
    cases = [
        Case(f"{cycle}/{name}", {"cycle": cycle, "control": name}, {"cycle": cycle, **call})
        for cycle in cycles
        for name, call in controls.items()
    ]
    if session.short:
        cases = [case.shortened(5.0 * SHORT_S) for case in cases]
    driven = session.drive(cases).set_index(["cycle", "control"]).run
    pairs = [(cycle, control) for cycle in cycles for control in (PREVIEW, BLIND)]
    calls = [
        {
            "run": driven[cycle, control],
            "other": driven[cycle, PRODUCTION],
            "by": BY_ALL if cycle in JUDGED_BY_ALL and not session.short else BY_CELLS,
        }
        for cycle, control in pairs
    ]
    names = [f"judges of {cycle}/{control}" for cycle, control in pairs]
    found = dict(zip(pairs, session.compute(verdicts, calls, names), strict=True))
    parts = {
        ", ".join(pair): iptm.compare(driven[pair[0], PRODUCTION], driven[pair]).parts.iloc[:, 0]
        for pair in pairs
    }
    rested = session.compute(
        parked, [{"by": BY_CELLS if session.short else BY_ALL}], ["a parked pack"], workers=1
    )[0]
    session.render(
        judges=_judges({pair: each.table for pair, each in found.items()}, SAVED),
        groups=_groups({pair: each.summary for pair, each in found.items()}),
        signs=_signs({pair: each.summary for pair, each in found.items()}),
        currents=_groups({pair: _medians(each.table, CURRENT) for pair, each in found.items()}),
        temperatures=_groups(
            {pair: _medians(each.table, TEMPERATURE) for pair, each in found.items()}
        ),
        heads=[(f"{pair}:", f"{{{pair}}}") for pair in map(", ".join, pairs)],
        numbers=[(f"{pair}:", f"{{{pair}:.1f}}") for pair in map(", ".join, pairs)],
        points=[(f"{pair}:", f"{{{pair}:+.1f}}") for pair in map(", ".join, pairs)],
        parts=pd.DataFrame(parts).rename_axis(["of", "part"]).reset_index(),
        parked=rested,
        years=_years(session, driven, cycles[0]),
        life_cycle=cycles[0],
        climate=CLIMATE,
        usage=USAGE,
    )
    return not any(each.failures for each in found.values())


def verdicts(run: iptm.Run, other: iptm.Run, by: tuple[str, ...]) -> Any:
    """Return what judges make of a run against another one."""
    return run.judge(other, by, crossed=True)


def life_points(run: iptm.Run, cell: str) -> float:
    """Return the capacity lost in years of use, in percentage points."""
    return float(life(run, cell=cell, climate=CLIMATE, usage=USAGE).lost.sum())


def parked(by: tuple[str, ...]) -> pd.DataFrame:
    """Return what judges give for a pack without current at two temperatures, in ppm, and the ratio."""
    groups = judge_groups(None)
    rows = []
    for each in (judge for group in by if group != "paper" for judge in groups[group]()):
        cold, hot = (_parked_loss(each, celsius) for celsius in PARKED_C)
        ratio = hot / cold if cold > 0.0 else np.nan
        labels = {"group": each.group, "judge": each.name}
        rows.append({**labels, "cold": 1e6 * cold, "hot": 1e6 * hot, "ratio": ratio})
    return pd.DataFrame(rows)


def _parked_loss(judge: Judge, celsius: float) -> float:
    time_s: FloatArray = np.linspace(0.0, PARKED_S, PARKED_S + 1, dtype=np.float64)
    charge: FloatArray = np.full(time_s.size, 0.9)
    kelvin: FloatArray = np.full(time_s.size, celsius + CELSIUS_ZERO_K)
    return judge.loss(Exposure(time_s, charge, kelvin))


def _judges(tables: Mapping[tuple[str, str], pd.DataFrame], column: str) -> pd.DataFrame:
    table = pd.DataFrame({", ".join(pair): each[column] for pair, each in tables.items()})
    return (
        table.reindex(max(tables.values(), key=len).index)
        .rename_axis(["group", "judge"])
        .reset_index()
    )


def _groups(summaries: Mapping[tuple[str, str], pd.DataFrame]) -> pd.DataFrame:
    texts = {
        ", ".join(pair): {group: _spread(row) for group, row in each.iterrows()}
        for pair, each in summaries.items()
    }
    order = max(summaries.values(), key=len).index
    return pd.DataFrame(texts).reindex(order).fillna("").rename_axis("group").reset_index()


def _signs(summaries: Mapping[tuple[str, str], pd.DataFrame]) -> tuple[int, list[str]]:
    """Return in how many columns two groups of cells agree in the sign of the median, and the others."""
    medians = pd.DataFrame({", ".join(pair): each.iloc[:, 0] for pair, each in summaries.items()})
    signs = np.sign(medians.loc[[CELLS, BLAST]])
    differ = signs.nunique() > 1
    return int((~differ).sum()), [*signs.columns[differ]]


def _spread(row: pd.Series) -> str:
    median, lowest, highest, judges = row.iloc[:4]
    return f"{median:.1f}" + (f" ({lowest:.1f} to {highest:.1f})" if judges > 1 else "")


def _medians(table: pd.DataFrame, column: str) -> pd.DataFrame:
    return table[column].groupby(level=0, sort=False).agg(["median", "min", "max", "size"])


def _years(session: Session, driven: pd.Series, cycle: str) -> pd.DataFrame:
    """Return what years of such trips cost by each cell, and what is saved of it, in points and percent."""
    if session.short:
        return pd.DataFrame()
    calls = [
        {"run": driven[cycle, control], "cell": cell}
        for cell in LIFE_CELLS
        for control in (PRODUCTION, PREVIEW, BLIND)
    ]
    names = [f"{call['cell']} after years, {place}" for place, call in enumerate(calls)]
    points = np.reshape(session.compute(life_points, calls, names), (len(LIFE_CELLS), 3))
    return pd.DataFrame(
        {
            "cell": LIFE_CELLS,
            "lost": points[:, 0],
            "preview": points[:, 0] - points[:, 1],
            "preview_percent": 100.0 * (1.0 - points[:, 1] / points[:, 0]),
            "blind": points[:, 0] - points[:, 2],
            "blind_percent": 100.0 * (1.0 - points[:, 2] / points[:, 0]),
        }
    )

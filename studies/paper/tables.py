"""Tables of the page in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from studies.paper import checks, statements, trips

REFERENCE, PROPOSED, VICE = (
    f"strategies/{name}" for name in ("reference", "aging", "energy_aging")
)
MULTI_HORIZON, OPTIMUM = "long_horizon/3+5", "whole_trip/aging"
LABELS = {  # of a figure: label with unit, decimals
    "cooling_energy": ("Cooling energy [kJ]", 2),
    "traction_energy_battery": ("Traction energy at the battery [kJ]", 2),
    "traction_energy": ("Traction energy ∫P_tra dt [kJ]", 2),
    "battery_energy": ("Battery energy ∫P_b dt [kJ]", 2),
    "total_energy_printed": ("∫P_tra dt + cooling [kJ]", 2),
    "cell_1_degradation": ("Degradation of cell 1 [10⁻⁵]", 4),
    "cell_n_degradation": ("Degradation of cell N [10⁻⁵]", 4),
    "inconsistency": ("Degradation inconsistency [10⁻⁷]", 3),
    "total_degradation": ("Degradation, both cells [10⁻⁵]", 4),
    "cell_1_temperature_mean": ("Cell 1, mean temperature [°C]", 2),
    "cell_n_temperature_mean": ("Cell N, mean temperature [°C]", 2),
    "cell_n_temperature_max": ("Cell N, highest temperature [°C]", 2),
    "settled_temperature": ("Mean cell temperature, last three quarters [°C]", 2),
    "smallest_margin": ("Smallest margin to s_min [m]", 3),
    "mean_gap": ("Mean gap [m]", 1),
    "mean_power": ("Mean battery power [kW]", 3),
    "mean_cop": ("Mean coefficient of performance", 2),
    "gap_violations": ("Gap limit broken [rows]", 0),
    "soft_violations": ("Soft limits broken [rows]", 0),
    "hard_violations": ("Hard limits broken [rows]", 0),
    "fallbacks": ("Ticks on a fallback", 0),
    "interventions": ("Interventions of the safety monitor", 0),
}
PAPER_ROWS = (
    "cooling_energy",
    "traction_energy",
    "total_energy_printed",
    "cell_1_degradation",
    "cell_n_degradation",
    "inconsistency",
)
LABELLED = {battery: labelled for labelled, battery in statements.AT_BATTERY.items()}
TABLE_IV = (
    *PAPER_ROWS[:2],
    "traction_energy_battery",
    "total_energy_printed",
    "battery_energy",
    *PAPER_ROWS[3:],
)


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def number(value: float, figure: str) -> str:
    """Return a figure without its unit; a dash for an unknown one."""
    if not np.isfinite(value):
        return "–"
    return f"{value:,.{LABELS[figure][1]}f}".replace(",", " ")


def name_of(address: str) -> str:
    """Return a run in words."""
    study, _, rest = address.partition("/")
    parts = [trips.NAMES.get(part, part.replace("_", " ")) for part in rest.split("/")]
    prefix = {"sampling_time": "MH ", "long_horizon": "MH ", "prediction_horizon": "SH "}
    return prefix.get(study, "") + ", ".join(parts)


def change(figures: pd.DataFrame, run: str, figure: str, base: str = REFERENCE) -> float:
    """Relative change of a figure against a base run in percent."""
    return float(statements.changes(figures, [run], base, figure)[0])


def verdict_counts(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """Numbers of reproduced, in sign only, not reproduced and not tested statements, by topic and set."""
    claims = statements.claims()
    rows = []
    for topic in [*dict.fromkeys(claims.topic), ""]:
        row: list[object] = [topic or "**all statements**", 0]
        for found in verdicts.values():
            part = found[claims.topic == topic] if topic else found
            row[1] = len(part)
            row.append(
                " / ".join(str(int((part.verdict == mark).sum())) for mark in statements.VERDICTS)
            )
        rows.append(row)
    return markdown(["statements about", "number", *verdicts], rows)


def by_topic(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """Every statement by topic, with what each set finds."""
    claims, parts = statements.claims(), []
    for topic, part in claims.groupby("topic", sort=False):
        rows = []
        for key, claim in part.iterrows():
            note = f" {claim.note}" if claim.note else ""
            cells = [
                f"{found.at[key, 'verdict']}{_at_battery(found.loc[key])} {found.at[key, 'found']}"
                for found in verdicts.values()
            ]
            statement = f"{claim.statement} ({claim['where']}){note}"
            rows.append([statement, checks.in_print(claim), *cells])
        parts.append(f"### {topic}\n\n{markdown(['statement', 'in print', *verdicts], rows)}")
    return "\n\n".join(parts)


def _at_battery(found: pd.Series) -> str:
    """The mark of the other reading of the traction row, where that counts."""
    return f" ({found.at_battery} at the battery)" if found.at_battery else ""


def strategy_table(figures: pd.DataFrame) -> str:
    """Table IV: found values with their changes, above the printed ones; both have marks."""
    printed = statements.printed_table()
    rows: list[list[str]] = []
    for figure in TABLE_IV:
        column = printed[LABELLED.get(figure, figure)]
        found, print_row = [f"**{LABELS[figure][0]}**", "found"], ["", "printed"]
        for name in trips.NAMES:
            run = f"strategies/{name}"
            value, wanted = float(figures.at[run, figure]), float(column[run])
            text = f"{number(value, figure)} {statements.absolute(value, wanted)}"
            print_row.append(number(wanted, figure))
            if name != "reference":
                ours, theirs = (
                    change(figures, run, figure),
                    100.0 * (wanted / column[REFERENCE] - 1.0),
                )
                text += f" ({statements.percent(ours)} {statements.compared(ours, theirs)})"
                print_row[-1] += f" ({statements.percent(theirs)})"
            found.append(text)
        rows += [found, print_row]
    for figure in list(LABELS)[9:]:
        cells = [number(float(figures.at[f"strategies/{n}", figure]), figure) for n in trips.NAMES]
        rows.append([LABELS[figure][0], "found", *cells])
    return markdown(["figure", "", *trips.NAMES.values()], rows)


def absolute_figures(figures: Mapping[str, pd.DataFrame]) -> str:
    """For how many strategies a figure of Table IV is met, and how far off the reference is."""
    printed = statements.printed_table()
    rows = []
    for figure in TABLE_IV:
        cells = []
        for table in figures.values():
            column = printed[LABELLED.get(figure, figure)]
            found = {run: float(table.at[run, figure]) for run in column.index}
            met = sum(
                statements.absolute(x, column[run]) == statements.REPRODUCED
                for run, x in found.items()
            )
            off = 100.0 * (found[REFERENCE] / column[REFERENCE] - 1.0)
            cells.append(f"{met} of {len(found)} (reference {statements.percent(off)})")
        rows.append([LABELS[figure][0], *cells])
    return markdown(["figure", *figures], rows)


def of_headline(claims: pd.DataFrame) -> pd.Series:
    """Which statements are printed changes from the reference to MH 3+5."""
    between = (claims.run == MULTI_HORIZON) & (claims.base == REFERENCE)
    return between & (claims.check == "change")


def headline(figures: Mapping[str, pd.DataFrame]) -> str:
    """MH 3+5 against the reference: found by each set, and printed."""
    claims = statements.claims()
    part = claims[of_headline(claims)]
    wanted = dict(zip(part.figure, part.printed.astype(float), strict=True))
    wanted |= {battery: wanted[labelled] for battery, labelled in LABELLED.items()}
    rows = []
    for figure, printed in wanted.items():
        found = [change(table, MULTI_HORIZON, figure) for table in figures.values()]
        cells = [
            f"{statements.percent(value)} {statements.compared(value, printed)}" for value in found
        ]
        rows.append([LABELS[figure][0], statements.percent(printed), *cells])
    return markdown(["change, SH 15 reference to MH 3+5 aging", "printed", *figures], rows)


def printed_changes(figures: Mapping[str, pd.DataFrame]) -> str:
    """Every printed change with what each set finds, by how much of the print that is off, and two marks.

    Of two ends of a range, the worse one counts. The marks have no floor, unlike those of the statements.
    """
    claims = statements.claims()
    bounds = (statements.NARROW_SHARE, statements.CHANGE_SHARE)
    rows, met = [], {name: [0, 0] for name in figures}
    known = pd.concat([table.index.to_series() for table in figures.values()]).value_counts()
    everywhere = set(known[known == len(figures)].index)
    for _, claim in claims[claims.check == "change"].iterrows():
        if not {*statements.flat(statements.series(claim.run))} <= everywhere:
            rows.append([claim.statement, checks.in_print(claim), *["–"] * 4 * len(figures)])
            continue
        row = [claim.statement, checks.in_print(claim)]
        for name, table in figures.items():
            ends = checks.change_ends(claim, table)
            off = max((100.0 * (found / wanted - 1.0) for found, wanted in ends), key=abs)
            marks = [
                statements.worst(statements.compared(*end, share, 0.0) for end in ends)
                for share in bounds
            ]
            met[name] = [
                n + (m == statements.REPRODUCED) for n, m in zip(met[name], marks, strict=True)
            ]
            row += [
                " to ".join(statements.percent(found) for found, _ in ends),
                f"{off:+.0f} %",
                *marks,
            ]
        rows.append(row)
    counts = [cell for each in met.values() for cell in ("", "", *(f"**{n}**" for n in each))]
    rows.append([f"**of {len(rows)}**", "", *counts])
    heads = [
        f"{name}{part}" for name in figures for part in ("", ", off by", ", a tenth", ", a quarter")
    ]
    return markdown(["statement", "in print", *heads], rows)


def runs_table(
    figures: pd.DataFrame,
    runs: Sequence[str],
    base: Callable[[str], str],
    values: Sequence[str] = ("smallest_margin", "gap_violations", "fallbacks"),
    compared: Sequence[str] = (*PAPER_ROWS, "total_degradation"),
) -> str:
    """Runs as rows: figures of base runs, changes of the others, and some values."""
    rows = []
    for run in runs:
        against = base(run)
        cells = [
            number(float(figures.at[run, key]), key)
            if run == against
            else statements.percent(change(figures, run, key, against))
            for key in compared
        ]
        cells += [number(float(figures.at[run, key]), key) for key in values]
        rows.append([f"**{name_of(run)}**" if run == against else name_of(run), *cells])
    heads = [LABELS[key][0] for key in (*compared, *values)]
    return markdown(["run", *heads], rows)


def share_of_saving(figures: pd.DataFrame, run: str, reference: str, optimum: str) -> float:
    """Part of the possible saving of degradation that a run reaches, in percent."""
    lost, most, least = (
        float(figures.at[address, "total_degradation"]) for address in (run, reference, optimum)
    )
    return 100.0 * (most - lost) / (most - least)

"""The texts of the page (``page.md.j2``) from figures and verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from studies.paper import cooling, plots, statements, tables, trips

import iptm

HERE = Path(__file__).parent
AIM = 56
"""Statements that one set should reproduce."""
COST_TO_GO = "cost_to_go/comprehensive"


def draw(
    folder: Path, runs: Mapping[str, Mapping[str, Any]], figures: Mapping[str, pd.DataFrame]
) -> None:
    """Draw the pictures of the page into a folder."""
    plots.draw_all(folder, runs, figures)


def parts(
    runs: Mapping[str, Mapping[str, Any]],
    figures: Mapping[str, pd.DataFrame],
    verdicts: Mapping[str, pd.DataFrame],
) -> dict[str, str]:
    """Texts of the template by name."""
    texts = {
        "runs": str(sum(len({id(run) for run in each.values()}) for each in runs.values())),
        "counts": tables.verdict_counts(verdicts),
        "readings": readings(verdicts),
        "sets": sets_table(verdicts),
        "held_back": held_back(verdicts),
        "changed_rules": changed_rules(verdicts),
        **conclusion(verdicts),
        "absolute": tables.absolute_figures(figures),
        "headline": tables.headline(figures),
        "statements": tables.by_topic(verdicts),
        "search": search(),
        "printed_parameters": printed_parameters(),
        "cooling": cooling.table(),
        "payback": cooling.payback_table(runs),
    }
    for name, table in figures.items():
        texts[f"strategies_{name}"] = tables.strategy_table(table)
        texts[f"series_{name}"] = series(table)
    return texts


def sets_table(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """The marks of every set: all statements, and those that only one of them reproduces."""
    holds = {name: found.verdict == statements.REPRODUCED for name, found in verdicts.items()}
    rows = []
    for name, mine in holds.items():
        others = pd.concat([other for key, other in holds.items() if key != name], axis=1).any(
            axis=1
        )
        rows.append([name, int(mine.sum()), int((mine & ~others).sum())])
    rows.append(["one of them", int(pd.concat(holds.values(), axis=1).any(axis=1).sum()), "–"])
    return tables.markdown(["set", "statements reproduced", "by this set only"], rows)


def readings(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """Reproduced statements with each reading of the traction row."""
    rows = []
    for name, found in verdicts.items():
        other = found.as_labelled.where(found.as_labelled != "", found.verdict)
        both = (found.verdict == statements.REPRODUCED) & (other == statements.REPRODUCED)
        counts = [(column == statements.REPRODUCED).sum() for column in (found.verdict, other)]
        rows.append([name, *counts, both.sum(), (found.as_labelled != "").sum()])
    heads = [
        "set",
        "at the battery",
        "as labelled, ∫P_tra dt",
        "with both",
        "statements that it concerns",
    ]
    return tables.markdown(heads, rows)


def held_back(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """Reproduced statements among those that the search saw and those held back."""
    drawn = statements.held_back()
    rows = []
    for name, found in verdicts.items():
        unseen = found.index.isin(drawn)
        cells = []
        for part in (found[~unseen], found[unseen]):
            count = int((part.verdict == statements.REPRODUCED).sum())
            cells.append(f"{count} of {len(part)} ({100.0 * count / len(part):.0f} %)")
        rows.append([name, *cells])
    return tables.markdown(["set", "seen by the search", "held back"], rows)


def changed_rules(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """Statements whose rule was changed, with the marks by the former and by the present one."""
    former = statements.former_rules()
    rows = [
        [
            one.statement,
            one.why,
            *(f"{found.former[key]} → {found.verdict[key]}" for found in verdicts.values()),
        ]
        for key, one in former.iterrows()
    ]
    counts = [
        " → ".join(
            str((column == statements.REPRODUCED).sum()) for column in (one.former, one.verdict)
        )
        for one in verdicts.values()
    ]
    rows.append(["**reproduced, all statements**", "", *counts])
    return tables.markdown(["statement", "why the rule was changed", *verdicts], rows)


def conclusion(verdicts: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """How many statements hold with which set, which with only one, and the attempts for the others."""
    claims = statements.claims()
    holds = {name: found.verdict == statements.REPRODUCED for name, found in verdicts.items()}
    gated, printed = holds["gated"], holds["as_printed"]
    counts = ((gated & printed), (printed & ~gated), (gated & ~printed), ~(gated | printed))
    both, by_print, by_gate, neither = (int(each.sum()) for each in counts)

    def listed(which: pd.Series) -> str:
        return "\n".join(f"- {statement}" for statement in claims[which].statement)

    most = max(int(each.sum()) for each in holds.values())
    before = max(int((found.former == statements.REPRODUCED).sum()) for found in verdicts.values())
    missed = claims[~printed]
    tried = missed.statement + " *" + missed.why.replace("", "Nothing was tried.") + "*"
    return {
        "conclusion": f"{both} statements hold with both sets, {by_print} as printed only, {by_gate} with the"
        f" added physics only, and {neither} with neither.",
        "aim": f"The aim was {AIM} of {len(claims)} under one set; the most is {most}, by the former"
        f" rules {before}.",
        "printed_only": listed(counts[1]),
        "gated_only": listed(counts[2]),
        "not_printed": "\n".join("- " + tried),
    }


def search() -> str:
    """The hypotheses that were driven in the search, from ``search.csv``."""
    table = pd.read_csv(HERE / "search.csv", dtype=str, keep_default_na=False)
    return tables.markdown(table.columns, table.itertuples(index=False))


def printed_parameters() -> str:
    """Tables I and II: printed and used, which a set may not change."""
    rows = []
    for line in pd.read_csv(HERE / "parameters.csv").itertuples():
        used = [iptm.load_parameters(name).sources[line.parameter] for name in (trips.VEHICLE,)]
        cells = [f"{source.value:.10g} {source.unit}" for source in used]
        rows.append([line.table, line.parameter, f"{line.printed:.10g} {line.unit}", *cells])
    return tables.markdown(["table", "parameter", "printed", "used"], rows)


def series(figures: pd.DataFrame) -> str:
    """Weights, horizons, sampling times and lengths: changes against the single horizon of 15 steps."""
    texts = []
    for title, study, base in (
        ("Weights (Fig. 9)", "weighting/", tables.REFERENCE),
        ("Prediction horizon (Fig. 10)", "prediction_horizon/", tables.PROPOSED),
        ("Sampling time of the long horizon (Fig. 12)", "sampling_time/", tables.PROPOSED),
        ("Length of the long horizon (Fig. 13)", "long_horizon/", tables.PROPOSED),
    ):
        runs = [base, *(address for address in figures.index if address.startswith(study))]
        bases = dict.fromkeys(runs, base)
        shown = ("solve_total", "cell_n_temperature_max")
        table = tables.runs_table(figures, runs, bases.__getitem__, shown)
        texts.append(f"#### {title}\n\n{table}")
    return "\n\n".join(texts)


def regeneration(figures: pd.DataFrame) -> str:
    """WLTC with two regenerative efficiencies: changes against the reference with the same one."""

    def reference(run: str) -> str:
        return f"{run.rpartition('/')[0]}/reference"

    shown = ("traction_energy_battery", "battery_energy", "total_degradation")
    return tables.runs_table(figures, list(figures.index), reference, (), shown)


def beyond(figures: pd.DataFrame) -> dict[str, str]:
    """Tables of the studies beyond the paper."""

    def those(pattern: str, without: str = "\0") -> list[str]:
        return [a for a in figures.index if a.startswith(pattern) and without not in a]

    def table(study: str, base: Any, without: str = "\0", **more: Any) -> str:
        return tables.runs_table(figures, those(study, without), base, **more)

    def second(run: str) -> str:
        return run.split("/")[1]

    optimum = tables.runs_table(
        figures,
        [tables.REFERENCE, tables.PROPOSED, tables.MULTI_HORIZON, tables.OPTIMUM],
        lambda _: tables.REFERENCE,
    )
    shares = {
        tables.name_of(run): tables.share_of_saving(figures, run, *ends)
        for runs, ends in (
            (
                [tables.PROPOSED, tables.VICE, tables.MULTI_HORIZON, "long_horizon/3+20"],
                (tables.REFERENCE, tables.OPTIMUM),
            ),
            (
                [
                    f"{COST_TO_GO}/{name}/perfect"
                    for name in (
                        "multi_horizon",
                        "multi_horizon_cost_to_go",
                        "long_horizon_cost_to_go",
                    )
                ],
                (f"{COST_TO_GO}/reference/perfect", f"{COST_TO_GO}/whole_trip/perfect"),
            ),
        )
        for run in runs
    }
    return {
        "optimum": optimum,
        "shares": tables.markdown(
            ["run", "part of the possible saving"], [[k, f"{v:.1f} %"] for k, v in shares.items()]
        ),
        "cost_to_go": table(COST_TO_GO, lambda _: f"{COST_TO_GO}/reference/perfect"),
        "cost_to_go_trips": table(
            "cost_to_go/",
            lambda run: f"cost_to_go/{second(run)}/reference/perfect",
            "/comprehensive/",
        ),
        "omitted": table(
            "omitted_parameters/",
            lambda run: f"omitted_parameters/{second(run)}/reference",
            values=("cell_n_temperature_max", "smallest_margin", "gap_violations", "fallbacks"),
        ),
        "full_channel": table("full_channel/", lambda run: f"full_channel/{second(run)}/reference"),
    }

"""The texts of the page (``page.md.j2``) from figures and verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from studies.paper import checks, cooling, plots, tables, trips

import iptm

HERE = Path(__file__).parent
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
    terms: pd.DataFrame,
) -> dict[str, str]:
    """Texts of the template by name."""
    texts = {
        "runs": str(sum(len({id(run) for run in each.values()}) for each in runs.values())),
        "counts": tables.verdict_counts(verdicts),
        "readings": readings(verdicts),
        "sets": sets_table(verdicts),
        "held_back": held_back(verdicts),
        "conclusion": conclusion(verdicts),
        "headline": tables.headline(figures),
        "statements": tables.statements(verdicts),
        "terms": tables.markdown(terms.columns, terms.itertuples(index=False)),
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
    holds = {name: found.verdict == checks.REPRODUCED for name, found in verdicts.items()}
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
        both = (found.verdict == checks.REPRODUCED) & (other == checks.REPRODUCED)
        counts = [(column == checks.REPRODUCED).sum() for column in (found.verdict, other)]
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
    drawn = checks.held_back()
    rows = []
    for name, found in verdicts.items():
        unseen = found.index.isin(drawn)
        cells = []
        for part in (found[~unseen], found[unseen]):
            count = int((part.verdict == checks.REPRODUCED).sum())
            cells.append(f"{count} of {len(part)} ({100.0 * count / len(part):.0f} %)")
        rows.append([name, *cells])
    return tables.markdown(["set", "seen by the search", "held back"], rows)


def conclusion(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """How many statements hold with which set, and which hold with none."""
    holds = {name: found.verdict == checks.REPRODUCED for name, found in verdicts.items()}
    gated, printed = holds["gated"], holds["as_printed"]
    neither = checks.claims()[~(gated | printed)]
    words = (
        f"{int((gated & printed).sum())} statements hold with both sets, {int((printed & ~gated).sum())} as "
        f"printed only, {int((gated & ~printed).sum())} with the added physics only, and {len(neither)} with "
        "neither:"
    )
    return "\n".join([words, "", *(f"- {claim.statement}" for claim in neither.itertuples())])


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
    values = ("cell_n_temperature_max", "smallest_margin", "gap_violations", "fallbacks")
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
        "cold_days": table(
            "cold_days/",
            lambda run: f"{run.rpartition('/')[0]}/without_limits",
            compared=("traction_energy",),
        ),
        "previews": table(
            "imperfect_previews/", lambda _: "imperfect_previews/perfect/reference", values=values
        ),
        "omitted": table(
            "omitted_parameters/",
            lambda run: f"omitted_parameters/{second(run)}/reference",
            values=values,
        ),
        "full_channel": table("full_channel/", lambda run: f"full_channel/{second(run)}/reference"),
        "discretisation": table(
            "discretisation/", lambda run: f"discretisation/{second(run)}/fine"
        ),
        "weighting_scale": table("weighting_scale/", lambda _: tables.REFERENCE)
        if tables.REFERENCE in figures.index
        else "",
        "first_composition": table("first_composition/", lambda _: "first_composition/reference"),
    }

"""The texts of the page (``page.md.j2``) from figures and verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from studies.paper import checks, cooling, plots, statements, tables, trips

import iptm

FIT, BASE = "as_printed", "gated"
"""The set whose numbers were searched on the statements, and the one that it is compared with."""
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
        "not_driven": not_driven(runs),
        "readings": readings(verdicts),
        "sets": sets_table(verdicts),
        **held_back(verdicts),
        "ratio": ratio(verdicts),
        "printed_changes": tables.printed_changes(figures),
        **conclusion(verdicts),
        "absolute": tables.absolute_figures(figures),
        "headline": tables.headline(figures),
        "statements": tables.by_topic(verdicts),
        "printed_parameters": printed_parameters(),
        "cooling": cooling.table(),
        "payback": cooling.payback_table(runs),
    }
    for name, table in figures.items():
        texts[f"strategies_{name}"] = tables.strategy_table(table)
        texts[f"series_{name}"] = series(table)
    return texts


def not_driven(runs: Mapping[str, Mapping[str, Any]]) -> str:
    """How many runs of the paper are lacking, by study and set; an empty text where none is."""
    planned = trips.paper_runs()
    lacking = [
        f"{count} of {study} with {name}"
        for name, driven in runs.items()
        for study in dict.fromkeys(address.partition("/")[0] for address in planned)
        if (count := sum(a.startswith(f"{study}/") and a not in driven for a in planned))
    ]
    return (
        f"Runs that are still to be driven: {', '.join(lacking)}. Statements that need one are not tested."
        if lacking
        else ""
    )


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
        other = found.at_battery.where(found.at_battery != "", found.verdict)
        both = (found.verdict == statements.REPRODUCED) & (other == statements.REPRODUCED)
        counts = [(column == statements.REPRODUCED).sum() for column in (found.verdict, other)]
        rows.append([name, *counts, both.sum(), (found.at_battery != "").sum()])
    heads = [
        "set",
        "as labelled, ∫P_tra dt",
        "at the battery",
        "with both",
        "statements that it concerns",
    ]
    return tables.markdown(heads, rows)


def held_back(verdicts: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Reproduced statements among those that the search saw and those held back, and what follows."""
    unseen = (statements.claims().held_back != "").to_numpy()
    rows, met = [], {}
    for name, found in verdicts.items():
        parts = [(found.verdict[which] == statements.REPRODUCED) for which in (~unseen, unseen)]
        rows.append([name, *(f"{p.sum()} of {len(p)} ({100.0 * p.mean():.0f} %)" for p in parts)])
        met[name] = int(parts[1].sum())
    more = met[FIT] - met[BASE]
    # Of two counts, each of statements that are met half of the time.
    deviation = (2.0 * unseen.sum() * 0.5 * 0.5) ** 0.5
    words = "is" if more > 2.0 * deviation else "is no"
    return {
        "held_back": tables.markdown(["set", "seen by the search", "held back"], rows),
        "evidence": f"Of the statements held back, {FIT} reproduces {met[FIT]} and {BASE} {met[BASE]}."
        f" That {words} evidence for eq. (14) as printed",
    }


def ratio(verdicts: Mapping[str, pd.DataFrame]) -> str:
    """What MH 3+5 gains over SH 15 in print, and with each set with its mark."""
    key = "multi-over-single"
    found = [f"{one.found[key]} with {name} ({one.verdict[key]})" for name, one in verdicts.items()]
    printed = checks.in_print(statements.claims().loc[key])
    return (
        f"Degradation of both cells, MH 3+5 against SH 15: {printed} in print, {', '.join(found)}."
    )


def conclusion(verdicts: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """How many statements hold with which set, which with only one, and the attempts for the others."""
    claims = statements.claims()
    holds = {name: found.verdict == statements.REPRODUCED for name, found in verdicts.items()}
    gated, printed = holds["gated"], holds["as_printed"]
    tested = verdicts["as_printed"].verdict != "–"
    counts = (
        gated & printed,
        printed & ~gated,
        gated & ~printed,
        tested & ~(gated | printed),
    )
    both, by_print, by_gate, neither = (int(each.sum()) for each in counts)

    def listed(which: pd.Series) -> str:
        return "\n".join(f"- {statement}" for statement in claims[which].statement)

    missed = claims[tested & ~printed]
    whys = missed.why.map(lambda why: f" *{why}*" if why else "")
    return {
        "conclusion": f"{both} statements hold with both sets, {by_print} as printed only, {by_gate} with the"
        f" added physics only, and {neither} with neither.",
        "printed_only": listed(counts[1]),
        "gated_only": listed(counts[2]),
        "not_printed": "\n".join("- " + missed.statement + whys),
    }


def gaps(runs: Mapping[str, Mapping[float, pd.DataFrame]]) -> str:
    """What MH 3+5 gains over SH 15 and over the benchmark, by set and largest gap."""
    compared = (
        ("total_degradation", tables.PROPOSED),
        ("cell_1_degradation", tables.REFERENCE),
        ("cell_n_degradation", tables.REFERENCE),
        ("cooling_energy", tables.REFERENCE),
        ("traction_energy", tables.REFERENCE),
        ("inconsistency", tables.REFERENCE),
    )
    rows = [
        [
            name,
            f"{gap_m:g}",
            *(
                statements.percent(tables.change(table, tables.MULTI_HORIZON, figure, base))
                for figure, base in compared
            ),
        ]
        for name, found in runs.items()
        for gap_m, table in found.items()
    ]
    heads = [
        f"{tables.LABELS[figure][0].partition(' [')[0]}, MH 3+5 against {trips.NAMES[base.partition('/')[2]]}"
        for figure, base in compared
    ]
    return tables.markdown(["set", "largest gap [m]", *heads], rows)


def printed_parameters() -> str:
    """Tables I and II: printed and used, which a set may not change."""
    rows = []
    for line in pd.read_csv(statements.HERE / "parameters.csv").itertuples():
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
        table = tables.runs_table(figures, runs, bases.__getitem__, ("cell_n_temperature_max",))
        texts.append(f"#### {title}\n\n{table}")
    return "\n\n".join(texts)


def regeneration(figures: pd.DataFrame) -> str:
    """WLTC with two regenerative efficiencies: changes against the reference with the same one."""

    def reference(run: str) -> str:
        return f"{run.rpartition('/')[0]}/reference"

    shown = ("traction_energy", "battery_energy", "total_degradation")
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

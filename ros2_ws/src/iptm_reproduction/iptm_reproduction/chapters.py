"""The order of the report."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from iptm_reproduction.beyond_chapters import BEYOND_THE_PAPER
from iptm_reproduction.causes import causes, remarks
from iptm_reproduction.check import check_topic
from iptm_reproduction.claims import TOPICS
from iptm_reproduction.claims.sensitivity import HORIZON, LENGTH, SAMPLING_TIME, WEIGHTS
from iptm_reproduction.claims.strategies import AGING_MODEL, HEADLINE, POWER, STRATEGY_TABLE, TRIP
from iptm_reproduction.document import Document, Table
from iptm_reproduction.gathering import Gathered
from iptm_reproduction.parts import (
    RULES_TEXT,
    Chapter,
    Material,
    Part,
    claims,
    incomplete,
    origin_table,
    other_trip,
    picture,
    runs_used,
    table,
    text,
    verdicts,
)
from iptm_reproduction.plots import (
    comparison_plots,
    identification_plots,
    model_plots,
    power_plots,
    sensitivity_plots,
    trip_plots,
)
from iptm_reproduction.printed import PAPER, PARAMETER_TABLES
from iptm_reproduction.runs import (
    FIRST_MULTI_HORIZON,
    FIRST_REFERENCE,
    HORIZONS_S,
    MULTI_HORIZON,
    PROPOSED,
    REFERENCE,
    SHORT_STEP_COUNTS,
    SPLITS,
    STRATEGIES,
    STUDIES,
    WEIGHTED,
    horizons,
    lengthened,
    sampled,
    weighted,
)
from iptm_reproduction.tables.analysis_tables import (
    cooling_table,
    discretisation_table,
    payback_table,
)
from iptm_reproduction.tables.identification_tables import (
    determined_table,
    first_composition_table,
    printed_cooling_table,
    settled_table,
)
from iptm_reproduction.tables.paper_tables import (
    formulation_table,
    headline_table,
    omitted_parameter_table,
    parameter_table,
    ranking_text,
    strategy_table,
)
from iptm_reproduction.tables.study_tables import reliability_table, run_table, weight_table

TITLE = "Reproduction of the paper"
IDENTIFICATION_TEXT = (
    "The paper gives neither the order of its segments, nor their slopes, nor several parameters. They are "
    "fitted to its strategy table (`scripts/identify`): the absolute figures of the reference and the "
    "changes of the other strategies. The starting point of the fit was found by hand with an eye on the "
    "headline of the multi-horizon grid, too, which therefore is not an independent test; everything else on "
    "this page (weights, horizons, sampling times, temperatures and spacing) is what the fit is tested on. "
    "The trip ships as cycle `comprehensive_identified`, the parameters as set `paper_identified`."
)


def compose(gathered: Gathered) -> Document:
    """Check every statement and put the report together; parts that cannot be built state the reason."""
    reasons, notes = causes(gathered.results), remarks(gathered.results)
    checked = {topic.title: check_topic(topic, gathered.results, reasons) for topic in TOPICS}
    material = Material(gathered.results, gathered.provenance, gathered.command, checked)
    sections = (chapter.section(material, notes.get(chapter.key, "")) for chapter in CHAPTERS)
    return Document(TITLE, PAPER, tuple(sections))


def _without_runs(build: Callable[[], Table]) -> Part:
    """Show a table that does not depend on any run."""
    return lambda _: build()


def _study(study: str, base: str, paper: str, runs: tuple[str, ...]) -> Part:
    """Show all runs of a study against one run."""
    build = partial(run_table, study=study, base=base, paper=paper)
    return table(f"{study.replace('_', '-')}-table", STUDIES[study], build, any_of=runs)


def _cooling(key: str, runs: tuple[str, ...]) -> Part:
    """Show when the compressor runs, for those of the runs that are there."""
    build = partial(cooling_table, key=key, addresses=runs)
    return table(key, "When the compressor runs", build, any_of=runs)


CHAPTERS = (
    Chapter(
        "summary",
        "Summary",
        (
            runs_used,
            other_trip,
            verdicts,
            text(lambda _: RULES_TEXT),
            incomplete,
            table("headline", "Headline comparison", headline_table, (MULTI_HORIZON, REFERENCE)),
            picture(comparison_plots.headline),
            claims(HEADLINE),
        ),
    ),
    Chapter(
        "parameters",
        "Parameters and formulations",
        (
            *(_without_runs(partial(parameter_table, printed)) for printed in PARAMETER_TABLES),
            _without_runs(omitted_parameter_table),
            _without_runs(formulation_table),
        ),
    ),
    Chapter(
        "identification",
        "What the paper pins down",
        (
            text(lambda _: IDENTIFICATION_TEXT),
            _without_runs(determined_table),
            picture(identification_plots.determined),
            _without_runs(settled_table),
            _without_runs(printed_cooling_table),
            table(
                "first-composition",
                "Headline on the identified trip and on this project's own composition",
                first_composition_table,
                (MULTI_HORIZON, REFERENCE),
                (FIRST_MULTI_HORIZON, FIRST_REFERENCE),
            ),
        ),
    ),
    Chapter(
        "model",
        "Aging model and driving cycle",
        (picture(model_plots.aging_map), claims(AGING_MODEL), picture(model_plots.driving_cycle)),
    ),
    Chapter(
        "strategies",
        "Six strategies on a single horizon",
        (
            table(
                "strategies",
                "Comparisons among different strategies",
                strategy_table,
                (REFERENCE, PROPOSED),
            ),
            text(ranking_text),
            picture(comparison_plots.strategy_changes),
            claims(STRATEGY_TABLE),
        ),
    ),
    Chapter(
        "power",
        "Power",
        (
            picture(power_plots.power_distribution),
            picture(power_plots.power_statistics),
            picture(power_plots.power_profiles),
            claims(POWER),
        ),
    ),
    Chapter(
        "trip",
        "Temperature, degradation and spacing",
        (
            picture(trip_plots.temperature_comparison),
            _cooling("cooling-strategies", STRATEGIES),
            table(
                "payback",
                "How long cooling takes to pay",
                lambda results: payback_table(results[PROPOSED]),
                (PROPOSED,),
            ),
            picture(trip_plots.degradation_comparison),
            picture(trip_plots.spacing),
            claims(TRIP),
        ),
    ),
    Chapter(
        "weights",
        "Sensitivity to the weights",
        (
            table(
                "weights",
                "Weights of the weighted strategies",
                weight_table,
                any_of=weighted(*WEIGHTED),
            ),
            picture(sensitivity_plots.weighting),
            claims(WEIGHTS),
        ),
    ),
    Chapter(
        "horizon",
        "Sensitivity to the prediction horizon",
        (
            _study("prediction_horizon", REFERENCE, "Fig. 10", horizons(*HORIZONS_S)),
            picture(sensitivity_plots.prediction_horizon),
            picture(trip_plots.horizon_temperatures),
            _cooling("cooling-horizons", horizons(*HORIZONS_S)),
            claims(HORIZON),
        ),
    ),
    Chapter(
        "sampling-time",
        "Multi-horizon: sampling time of the long horizon",
        (
            _study("sampling_time", PROPOSED, "Fig. 12", sampled(*SPLITS)),
            picture(sensitivity_plots.sampling_time),
            claims(SAMPLING_TIME),
        ),
    ),
    Chapter(
        "long-horizon",
        "Multi-horizon: length of the long horizon",
        (
            _study("long_horizon", PROPOSED, "Fig. 13", lengthened(*SHORT_STEP_COUNTS)),
            picture(sensitivity_plots.long_horizon),
            claims(LENGTH),
            table(
                "discretisation-table",
                STUDIES["discretisation"],
                discretisation_table,
                ("discretisation/28/3+5", "discretisation/28/fine"),
            ),
            picture(comparison_plots.discretisation),
        ),
    ),
    *BEYOND_THE_PAPER,
    Chapter(
        "reliability",
        "Reliability and origin of the runs",
        (table("reliability", "Reliability", reliability_table), origin_table),
    ),
)

"""Chapters of the report on what goes beyond the paper."""

from __future__ import annotations

from functools import partial

from iptm_reproduction.parts import (
    Chapter,
    Part,
    picture,
    table,
    text,
)
from iptm_reproduction.plots import (
    channel_plots,
    comparison_plots,
    cost_to_go_plots,
    trip_plots,
)
from iptm_reproduction.runs import (
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    STUDIES,
    channel_run,
    cost_to_go_run,
    warm_run,
)
from iptm_reproduction.tables import channel_tables, cost_to_go_tables
from iptm_reproduction.tables.analysis_tables import (
    optimum_solve_table,
    optimum_table,
)
from iptm_reproduction.tables.robustness_tables import (
    conclusion_table,
    summary_text,
    variation_table,
)


def _robustness(
    study: str, first: str, base: str | None, conclusions: str, runs: str
) -> tuple[Part, ...]:
    """Show which conclusions hold whatever varies in a study, in words and as a table, and all its runs."""
    return (
        text(partial(summary_text, study=study)),
        table(
            f"conclusions-{study.replace('_', '-')}",
            "Conclusions",
            partial(conclusion_table, study=study, title=conclusions),
            (first,),
        ),
        table(
            study.replace("_", "-"),
            STUDIES[study],
            partial(variation_table, study=study, title=runs, base=base),
            (first,),
        ),
    )


BEYOND_THE_PAPER = (
    Chapter(
        "optimum",
        "Beyond the paper: the limit",
        (
            table(
                "optimum-table",
                "The whole trip as one problem",
                optimum_table,
                (REFERENCE, PROPOSED, OPTIMUM),
            ),
            picture(comparison_plots.saving_shares),
            picture(trip_plots.optimum),
            table("optimum-solves", "Solves of the whole trip", optimum_solve_table, (OPTIMUM,)),
        ),
    ),
    Chapter(
        "cost-to-go",
        "Beyond the paper: the cost to go",
        (
            table(
                "cost-to-go",
                "The saving with a cost to go, by horizon and by what is known of the leader",
                cost_to_go_tables.saving_table,
                (cost_to_go_run("reference"),),
            ),
            picture(cost_to_go_plots.temperature_price),
            table(
                "cost-to-go-trips",
                "The saving with a cost to go on other trips",
                cost_to_go_tables.trips_table,
                any_of=(cost_to_go_run("reference", "wltc_class3b"),),
            ),
            table(
                "cold-days",
                "The default controller on cold days",
                cost_to_go_tables.cold_days_table,
                (warm_run("wltc_class3b", "flat"),),
            ),
        ),
    ),
    Chapter(
        "previews",
        "Beyond the paper: imperfect previews",
        (
            picture(comparison_plots.imperfect_previews),
            *_robustness(
                "imperfect_previews",
                "imperfect_previews/perfect/reference",
                "imperfect_previews/perfect/reference",
                "Conclusions under imperfect previews",
                "All strategies under imperfect previews",
            ),
        ),
    ),
    Chapter(
        "omitted",
        "Beyond the paper: parameters that the paper omits",
        (
            picture(comparison_plots.omitted_parameters),
            *_robustness(
                "omitted_parameters",
                "omitted_parameters/as_chosen/reference",
                None,
                "Conclusions under other parameters",
                "All runs with other parameters",
            ),
        ),
    ),
    Chapter(
        "full-channel",
        "Beyond the paper: the full channel",
        (
            table(
                "channel-saving",
                "The saving with two cells and with the full channel",
                channel_tables.saving_table,
                (channel_run("reference"),),
            ),
            table(
                "channel",
                "Every cell of the channel, and the price of two",
                channel_tables.channel_table,
                (channel_run("reference"),),
            ),
            picture(channel_plots.full_channel),
        ),
    ),
)

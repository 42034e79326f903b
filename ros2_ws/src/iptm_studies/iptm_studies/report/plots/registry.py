"""Every figure of the report."""

from __future__ import annotations

from iptm_studies.report.addresses import expanded_all
from iptm_studies.report.plots.comparison_plots import (
    draw_discretisation,
    draw_headline,
    draw_omitted,
    draw_previews,
    draw_saving_shares,
    draw_strategy_changes,
)
from iptm_studies.report.plots.model_plots import draw_aging_map, draw_driving_cycle
from iptm_studies.report.plots.plot import Plot
from iptm_studies.report.plots.power_plots import (
    draw_power_distribution,
    draw_power_profiles,
    draw_power_statistics,
)
from iptm_studies.report.plots.sensitivity_plots import (
    draw_long_horizon,
    draw_prediction_horizon,
    draw_sampling_time,
    draw_weighting,
)
from iptm_studies.report.plots.trip_plots import (
    draw_degradation,
    draw_horizon_temperatures,
    draw_optimum,
    draw_spacing,
    draw_temperatures,
)
from iptm_studies.report.runs import HEADLINE_RUN, OPTIMUM_RUN, PROPOSED_RUN, REFERENCE_RUN


def _runs(*addresses: str) -> tuple[str, ...]:
    return expanded_all(addresses, "figures of the report")


_STRATEGIES = _runs(
    "strategies/{reference,reference_energy,reference_aging,reference_energy_aging,energy_aging,aging}"
)

PLOTS: dict[str, Plot] = {
    plot.key: plot
    for plot in (
        Plot(
            "aging_map",
            "Influence of current and temperature on degradation",
            "Capacity loss of a cell in one hour at constant current and temperature, at the initial "
            "loss of the parameters: over the permitted temperatures, and as sections.",
            (),
            draw_aging_map,
        ),
        Plot(
            "driving_cycle",
            "Driving cycle with slopes",
            "Speed of the leader and slope of the road where it drives. Shaded: stretches with large "
            "(L) and small (S) slope.",
            (REFERENCE_RUN,),
            draw_driving_cycle,
        ),
        Plot(
            "power_distribution",
            "Total power distributions",
            "Distribution over time of the power at the terminals of the pack, by strategy.",
            (REFERENCE_RUN, PROPOSED_RUN),
            draw_power_distribution,
            _STRATEGIES,
        ),
        Plot(
            "power_statistics",
            "Statistical power distributions",
            "Share of time by power for the proposed strategy and both benchmarks. The dotted lines "
            "part low, medium and high power: median and percentile 90 of the reference, for the paper "
            "gives no values.",
            (REFERENCE_RUN, PROPOSED_RUN),
            draw_power_statistics,
            ("strategies/energy_aging",),
        ),
        Plot(
            "temperature_comparison",
            "Temperatures under the six strategies",
            "Temperature of the first and the last cell of a coolant channel; dashed: limits. The line "
            "of the reference is drawn broad because others run over it.",
            (REFERENCE_RUN, PROPOSED_RUN),
            draw_temperatures,
            _STRATEGIES,
        ),
        Plot(
            "degradation_comparison",
            "Degradation under the six strategies",
            "Capacity loss of both cells since the start, and its difference to that under the reference.",
            (REFERENCE_RUN, PROPOSED_RUN),
            draw_degradation,
            _STRATEGIES,
        ),
        Plot(
            "power_profiles",
            "Traction and cooling power of the proposed strategy",
            "Left the whole trip, right the minutes with the most cooling (shaded on the left).",
            (PROPOSED_RUN,),
            draw_power_profiles,
        ),
        Plot(
            "spacing",
            "Spacing of the proposed strategy",
            "Gap between the limits for safety and traffic efficiency, and its margin to the lower "
            "limit. Where the line is thinned, the smallest value is kept.",
            (PROPOSED_RUN,),
            draw_spacing,
        ),
        Plot(
            "weighting",
            "Sensitivity to the weights",
            "Four weights per strategy, from small (light) to large (dark), in the order that the "
            "paper prints. The axes do not start at zero.",
            _runs("weighting/reference_energy/{1,2,3,4}"),
            draw_weighting,
            _runs("weighting/{reference_aging,reference_energy_aging,energy_aging}/{1,2,3,4}"),
        ),
        Plot(
            "prediction_horizon",
            "Sensitivity to the prediction horizon",
            "The proposed strategy on single horizons. The axes do not start at zero, but that of the "
            "computing time does.",
            _runs("prediction_horizon/{5,10,15,20}"),
            draw_prediction_horizon,
            (REFERENCE_RUN,),
        ),
        Plot(
            "horizon_temperatures",
            "Temperatures by prediction horizon",
            "Temperature of the first and the last cell under the proposed strategy; dashed: limits.",
            _runs("prediction_horizon/{5,10,15,20}"),
            draw_horizon_temperatures,
        ),
        Plot(
            "sampling_time",
            "Sampling time of the long horizon",
            "The proposed strategy on 15 steps, split into short and long ones. The axes do not start at "
            "zero.",
            _runs("sampling_time/{3+12,5+10,8+7,10+5,12+3}/{2,5,8,10,15}"),
            draw_sampling_time,
            (PROPOSED_RUN,),
        ),
        Plot(
            "long_horizon",
            "Length of the long horizon",
            "The proposed strategy with long steps of 5 s. The band is where the paper's changes "
            "against its single horizon would lie. The axes do not start at zero, but that of the "
            "computing time does.",
            _runs("long_horizon/{3,5}+{5,10,12,15,20}"),
            draw_long_horizon,
            (PROPOSED_RUN,),
        ),
        Plot(
            "strategy_changes",
            "Strategy table: found and printed",
            "Changes against the reference.",
            (REFERENCE_RUN, PROPOSED_RUN),
            draw_strategy_changes,
            _STRATEGIES,
        ),
        Plot(
            "headline",
            "Headline comparison: found and printed",
            "Aging on 3 × 1 s + 5 × 5 s against the reference on 15 × 1 s.",
            (REFERENCE_RUN, HEADLINE_RUN),
            draw_headline,
        ),
        Plot(
            "saving_shares",
            "Distance to the optimum",
            "Part of the possible saving of degradation: nothing for the reference, everything for the "
            "whole trip solved as one problem.",
            (REFERENCE_RUN, OPTIMUM_RUN),
            draw_saving_shares,
            (*_STRATEGIES, HEADLINE_RUN),
        ),
        Plot(
            "optimum",
            "What the optimum does differently",
            "Mean cell temperature, gap and capacity loss of both cells.",
            (REFERENCE_RUN, PROPOSED_RUN, OPTIMUM_RUN),
            draw_optimum,
        ),
        Plot(
            "imperfect_previews",
            "Imperfect previews",
            "Changes against the reference with perfect previews.",
            _runs("imperfect_previews/perfect/{reference,aging}"),
            draw_previews,
        ),
        Plot(
            "omitted_parameters",
            "Other values of what the paper omits",
            "Changes of the proposed strategy against the reference with the same values.",
            _runs("omitted_parameters/as_chosen/{reference,aging}"),
            draw_omitted,
        ),
        Plot(
            "discretisation",
            "Long steps against fine steps",
            "Multi-horizon grids against 1 s steps over the same length in seconds.",
            _runs("discretisation/28/{fine,3+5}"),
            draw_discretisation,
        ),
    )
}
"""Figures by key, the paper's first."""

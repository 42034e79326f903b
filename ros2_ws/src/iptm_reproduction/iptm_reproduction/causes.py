"""Why results differ from the paper, and remarks on whole chapters: what was looked for and found.

Numbers of results are not typed here but filled in from stored runs; a dash stands for a missing run.
"""

from __future__ import annotations

from iptm_reproduction.figure_texts import Numbers
from iptm_reproduction.figures import (
    CELL_1,
    CELL_N,
    CELL_N_MAX,
    CELL_N_MEAN,
    COOLING,
    INCONSISTENCY,
    MEAN_POWER,
    SMALLEST_GAP,
    TOTAL,
    TRACTION,
)
from iptm_reproduction.printed_cooling import reproduced_cooling
from iptm_reproduction.runs import (
    MULTI_HORIZON,
    OPTIMUM,
    PROPOSED,
    REF_AGING,
    REF_ENERGY,
    REFERENCE,
    VICE,
    Results,
)

CHILLER_PROPOSED = "omitted_parameters/published_chiller_35_degc/aging"
CHILLER_REFERENCE = "omitted_parameters/published_chiller_35_degc/reference"


def causes(results: Results) -> dict[str, str]:
    """Return the reason for each difference by claim id; shown unless the verdict is "reproduced"."""
    n, printed = Numbers(results), reproduced_cooling()
    cooling_share = (
        "The reference cools to its temperature at any price and the proposed strategy in part with what "
        f"braking feeds back ({n.braking_share(MULTI_HORIZON)} of its compressor energy), so that the "
        "change depends on how much the reference has to cool: on the start, the air and the chiller, "
        "which the paper does not give. The table of the parameters that the paper omits has the change "
        "under other values."
    )
    total_share = (
        f"The sum is traction and cooling: cooling is {n.value(REFERENCE, COOLING)} of "
        f"{n.value(REFERENCE, TOTAL)} for the reference here, printed {n.printed(REFERENCE, COOLING)} of "
        f"{n.printed(REFERENCE, TOTAL)}, and each changes by its own cause."
    )
    traction_trip = (
        "What can be saved in traction follows from the trip: hills and speeds of the leader, the largest "
        "gap and how far the preview reaches into a hill. They are identified from the strategy table, not "
        f"printed; the reference takes {n.value(REFERENCE, TRACTION)} here and "
        f"{n.printed(REFERENCE, TRACTION)} in print."
    )
    beyond_horizon = (
        f"Cooling with drawn power pays only after {n.payback(PROPOSED)} on this trip, which no grid of "
        "this comparison sees. The proposed strategy therefore leaves the pack warm "
        f"({n.value(MULTI_HORIZON, CELL_N_MEAN)} on average in cell N, the reference "
        f"{n.value(REFERENCE, CELL_N_MEAN)}), and that takes away most of what its lower powers save. It "
        "is not the model that stands against the printed size: known as a whole, the same trip changes "
        f"by {n.change(OPTIMUM, REFERENCE, CELL_1)} and {n.change(OPTIMUM, REFERENCE, CELL_N)}. What is "
        "missing is a value of a cool pack beyond the horizon, of which the paper says nothing."
    )
    vice_warm = (
        f"The energy term makes cooling dear: with J3 + J4 only {n.braking_share(VICE)} of the compressor "
        "energy is spent while braking, the rest to keep the upper limit, and cell N is at "
        f"{n.value(VICE, CELL_N_MEAN)} on average (aging alone {n.value(PROPOSED, CELL_N_MEAN)}, reference "
        f"{n.value(REFERENCE, CELL_N_MEAN)}). The warmth costs more life than the lower powers save. "
        f"Cooling pays after {n.payback(PROPOSED)} only, beyond the horizon of 15 s, so that the aging "
        "term does not ask for it, and while braking it gives back at most "
        f"{100.0 * printed.braking_refund:.0f} % of what the energy term charges. The "
        "printed numbers alone say the same: by them cooling pays "
        f'after {printed.pays_after_s:.0f} s (table "What the printed numbers say of cooling").'
    )
    terms_apart = (
        "In energies the energy term does save more. In degradation it does not, because it also lets the "
        f"pack get warmer ({n.value(REF_ENERGY, CELL_N_MEAN)} on average in cell N, with the aging term "
        f"{n.value(REF_AGING, CELL_N_MEAN)}). The two differ by little either way: "
        f"{n.change(REF_ENERGY, REFERENCE, CELL_1)} and {n.change(REF_AGING, REFERENCE, CELL_1)} for cell "
        "1."
    )
    vice_total = (
        f"Traction changes by {n.change(VICE, REFERENCE, TRACTION)} and cooling by "
        f"{n.change(VICE, REFERENCE, COOLING)}: with the energy term the controller cools only to keep the "
        "upper limit, so that it saves more of both than in print."
    )
    spread = (
        "The inconsistency follows the heat that the coolant takes up along the channel, and so the losses "
        "in the cells and how much of the cooling falls into pauses. Resistance, entropic coefficient and "
        "chiller are not printed; the table of what the paper pins down has how far they are known."
    )
    beyond_single = (
        f"Cooling with drawn power pays only after {n.payback(PROPOSED)} on this trip; a horizon of 15 s "
        f"sees no gain in it. Cell N is at {n.value(PROPOSED, CELL_N_MEAN)} on average (reference "
        f"{n.value(REFERENCE, CELL_N_MEAN)}), which takes away what lower powers save. With the whole trip "
        f"known, the same model allows {n.change(OPTIMUM, REFERENCE, CELL_1)} for cell 1. With the "
        "published chiller map, which gives more cold for the same power, 15 s are enough for "
        f"{n.change(CHILLER_PROPOSED, CHILLER_REFERENCE, CELL_1)} and "
        f"{n.change(CHILLER_PROPOSED, CHILLER_REFERENCE, CELL_N)} (table of the parameters that the paper "
        "omits)."
    )
    same_powers = (
        "Energy and aging both charge for the same powers, and the pack is at its upper limit with any of "
        "the ratios, so that their ratio hardly changes the driving. In print the runs with a large "
        "energy weight differ more; the paper does not say which size of the weights it took."
    )
    longer_sees_more = (
        "On 15 steps, longer ones also look further ahead: 3 + 12 steps reach 27 s with 2 s and 183 s "
        f"with 15 s. Cooling pays after {n.payback(PROPOSED)}, and the further a grid sees, the more of "
        "that it sees. What long steps themselves cost is small here, below 1 % against 1 s steps of the "
        'same length (table "Long steps against fine steps"), because each is integrated over several '
        "samples. A discretisation that takes one sample per step would show a price that rises with the "
        "step."
    )
    length_range = (
        "The sign and the growth with the length are those of the paper. The size is that of horizons "
        f"which do not see cooling pay ({n.payback(MULTI_HORIZON)})."
    )
    conventional_weights = (
        "The printed weights are run as printed; their effect depends on the size of powers and losses on "
        "the trip, which is identified and not printed."
    )
    return {
        "weight-energy-saves": conventional_weights,
        "weight-energy-degradation": conventional_weights,
        "weight-aging-little": conventional_weights,
        "weight-vice-degradation": same_powers,
        "weight-vice-trade-off": same_powers,
        "vice-comparable-energy": vice_total,
        "horizon-20-less-cooling": (
            "See the rise of cooling with the horizon: what falls with a longer one is braking, and with it "
            "the power to cool with."
        ),
        "step-mh-beats-sh": longer_sees_more,
        "step-3-best-split": longer_sees_more,
        "length-degradation": length_range,
        "length-levels-off": length_range,
        "headline-computing-time": (
            "The paper names neither solver nor machine. Here the structure of the problem is exploited, "
            "so that the time of a solve grows with the number of steps, and the multi-horizon grid has "
            "about half of them; a solver with a large part that does not depend on the number of steps "
            "would show the small printed difference."
        ),
        "settles-near-30": (
            f'Cooling with drawn power pays only after {n.payback(PROPOSED)} on this trip (table "How long '
            'cooling takes to pay"), far beyond any horizon of the paper. With aging as its only cost the '
            "controller therefore cools while braking, when the compressor uses what would otherwise flow "
            f"into the pack and age it ({n.braking_share(PROPOSED)} of its energy here), and the "
            "temperature stays where that leaves it. The printed temperature would need cells that cool "
            "much faster, a far better chiller, or a cost at the end of the horizon; the paper mentions "
            "none."
        ),
        "proposed-cooling": (
            "Most of the compressor energy of the proposed strategy is what braking feeds back "
            f"({n.braking_share(PROPOSED)}; of the reference {n.braking_share(REFERENCE)}), because "
            f"cooling with drawn power pays only after {n.payback(PROPOSED)}. The reference tracks its "
            "temperature at any price, so that the difference between both depends on how warm the trip "
            "begins and how soon the reference is reached."
        ),
        "horizon-cooling": (
            "The shorter the horizon, the harder the driving, and the more energy flows back while "
            "braking, which the compressor burns to keep it out of the pack: "
            f"{n.braking_share('prediction_horizon/5')} of the compressor energy is spent while braking "
            f'with 5 s, {n.braking_share("prediction_horizon/20")} with 20 s (table "When the compressor '
            f'runs"). Drawn power for cooling pays after {n.payback("prediction_horizon/20")} only, so '
            "that no horizon of this study adds to it."
        ),
        "horizon-5-least-cooling": (
            "See the rise of cooling with the horizon: with 5 s the vehicle brakes most, and the "
            "compressor runs on what that feeds back."
        ),
        "horizon-5-limit": (
            "See the rise of cooling with the horizon: with 5 s the vehicle brakes most, and the "
            "compressor runs on what that feeds back, so that the pack does not get warm."
        ),
        "horizon-20-coldest": (
            "See the rise of cooling with the horizon: a longer horizon brakes less, and so has less "
            "power to cool with."
        ),
        "horizon-cooled-before": (
            f"Cooling with drawn power pays only after {n.payback(PROPOSED)} on this trip. No horizon of "
            "this study sees a reason to cool in advance; what cooling there is follows the braking."
        ),
        "spacing-margin": (
            "Nothing in the aging cost asks for more distance than the limit, and the plan uses the limit "
            "up where that saves something. The parameters of the limit (s_st, T_h) are not printed; "
            "other values would shift the limit, not the margin to it. A margin that stays positive needs "
            "a reserve inside the controller that the paper does not mention."
        ),
        "headline-traction": traction_trip,
        "proposed-traction": traction_trip,
        "length-traction-range": traction_trip,
        "headline-inconsistency": spread,
        "headline-cooling": cooling_share,
        "headline-total": total_share,
        "headline-cell-1": beyond_horizon,
        "headline-cell-n": beyond_horizon,
        "headline-over-22": beyond_horizon,
        "all-formulations-save": vice_warm,
        "vice-degradation": vice_warm,
        "vice-beats-conventional": vice_warm,
        "vice-second-best": vice_warm,
        "reference-highest-degradation": vice_warm,
        "weight-none-reaches-proposed": (
            "Strategies with the temperature term of the reference keep the pack near 26 degC whatever "
            "that costs, which pays over the whole trip. Aging alone does not see that within its horizon "
            f"(cooling pays after {n.payback(PROPOSED)})."
        ),
        "energy-term-beats-aging-term": terms_apart,
        "energy-term-less-degradation": terms_apart,
        "both-terms-between": (
            "The paper prints only the ratio of both weights for J1-4, not their size. With the size "
            "chosen here the best of its four ratios has a far larger aging weight than the best of "
            "J1,2,4, and so saves more than either term alone; the table of the scale of the weights "
            "shows how much the size decides. In print, too, one of six figures lies outside."
        ),
        "proposed-beats-vice": (
            "Degradation and inconsistency are lower, as printed. In energy both strategies are the same "
            f"within {n.change(PROPOSED, VICE, TOTAL)}: what the proposed one saves in traction it spends on "
            "cooling, which the energy term of the vice benchmark avoids."
        ),
        "vice-total": vice_total,
        "vice-inconsistency": spread,
        "proposed-inconsistency": spread,
        "proposed-total": total_share,
        "proposed-degradation": beyond_single,
        "proposed-cell-1": beyond_single,
        "proposed-cell-n": beyond_single,
        "proposed-more-cooling-than-vice": (
            f"The proposed strategy cools while braking ({n.braking_share(PROPOSED)} of its compressor "
            f"energy), the vice benchmark ({n.braking_share(VICE)}) in order to keep the upper limit, at "
            "which it drives most of the time; the latter takes a little more."
        ),
        "proposed-lowest-power": (
            f"Mean power of both differs by {n.change(PROPOSED, VICE, MEAN_POWER)}. It is what the energy "
            "term of the vice benchmark minimises, while the aging term trades some of it for lower "
            "peaks."
        ),
        "power-regions": (
            "High power is rarer than under both benchmarks, as printed. Low power is more frequent than "
            "under the reference; against the vice benchmark it is the same within a fraction of a percent "
            f"of the time. Mean power of both differs by {n.change(PROPOSED, VICE, MEAN_POWER)}: the energy "
            "term lowers the powers as well as the aging term does, and leaves the compressor off."
        ),
        "vice-different-degradation": (
            "Neither of the two sees a reason to cool ahead within 15 s (it pays after "
            f"{n.payback(PROPOSED)}), so that both are warm, and what is left of the difference comes from "
            "cooling while braking and from peaks."
        ),
        "cools-off-peak": (
            "The compressor does run most while braking. At high traction power it runs, too, because the "
            f"cells are at their upper limit just then (cell N up to {n.value(PROPOSED, CELL_N_MAX)}), and "
            "the limit has to be kept. In the paper the pack stays near 30 degC, where nothing forces the "
            "compressor on."
        ),
        "weight-both-trade-off": (
            "With the size of the weights chosen here the four printed ratios all lie where a larger "
            "aging weight still lessens degradation. The paper does not print the size."
        ),
        "weight-vice-traction": same_powers,
        "weight-sensitive": same_powers,
        "horizon-saves": (
            "Traction energy falls at every step. Degradation does not: with a longer horizon the vehicle "
            "brakes less, feeds less back to cool with, and the pack gets warmer "
            f"({n.value('prediction_horizon/10', CELL_N_MEAN)} on average in cell N with 10 s, "
            f"{n.value('prediction_horizon/20', CELL_N_MEAN)} with 20 s)."
        ),
        "horizon-heats-in-demand": (
            "With the longest horizon the pack is near its upper limit before the demand begins, and "
            "cannot get much warmer."
        ),
        "step-cooling": longer_sees_more,
        "step-traction": longer_sees_more,
        "step-degradation": longer_sees_more,
        "step-5-best": longer_sees_more,
        "length-computing": (
            "Computing times are taken while the runs of the campaign share the machine, two at a time; "
            "neighbours in this series differ by less than that disturbs. The benchmarks have the times "
            "of a quiet machine."
        ),
        "length-traction": (
            "It falls with the length as a whole, by less than a percent; from step to step cooling ahead "
            "takes a little of it back."
        ),
        "length-cooling-range": (
            "The single horizon cools mostly while braking and a longer one brakes less; cooling ahead, "
            "which a longer horizon could pay for, needs more than its 28 to 105 s "
            f"({n.payback(MULTI_HORIZON)})."
        ),
        "length-cell-1-range": length_range,
        "length-cell-n-range": length_range,
        "length-inconsistency-range": (
            "Longer grids drive with lower powers and cool the first cell more, which sets the cells "
            "apart. The single horizon with aging alone is already far more even than in print "
            f"({n.value(PROPOSED, INCONSISTENCY)}, printed {n.printed(PROPOSED, INCONSISTENCY)})."
        ),
    }


def remarks(results: Results) -> dict[str, str]:
    """Return remarks by chapter key; shown at the beginning of the chapter, always."""
    n = Numbers(results)
    return {
        "previews": (
            "No controller knows what the leader does when its predictions are wrong, lost or absent. It "
            'is then s_min, a distance for comfort, that is broken in some rows (column "Gap limit '
            'broken"); nobody is touched: the smallest gap of the multi-horizon controller is '
            f"{n.value('imperfect_previews/none/multi_horizon', SMALLEST_GAP)} without any prediction and "
            f"{n.value('imperfect_previews/noise/multi_horizon', SMALLEST_GAP)} with noise, the standstill "
            "gap 5 m."
        )
    }

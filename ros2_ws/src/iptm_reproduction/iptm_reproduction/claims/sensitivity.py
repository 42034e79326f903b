"""What the paper says about the sensitivity to weights and prediction horizon."""

from __future__ import annotations

from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.numbers import value_between
from iptm_reproduction.checks.orders import all_lower
from iptm_reproduction.checks.temperatures import cooled_before_demand, heats_in_demand
from iptm_reproduction.checks.trends import FALLS, RISES, not_always, spread, trend
from iptm_reproduction.figures import (
    CELL_1,
    CELL_N,
    CELL_N_MAX,
    CELLS,
    COMPUTING_TIME,
    COOLING,
    FOUR,
    MEAN_TEMPERATURES,
    TRACTION,
)
from iptm_reproduction.runs import PROPOSED, REFERENCE, WEIGHTED, horizons, weighted

WEIGHTS = ClaimTopic(
    "Weighting sensitivity",
    (
        Claim(
            "weight-energy-saves",
            "Section IV-C.1, Fig. 9",
            "With J1-3, a larger weight on energy significantly reduces both cooling and traction energy.",
            trend(weighted("reference_energy"), {COOLING: FALLS, TRACTION: FALLS}, 0.01),
        ),
        Claim(
            "weight-energy-degradation",
            "Section IV-C.1, Fig. 9",
            "With J1-3, degradation does not always decrease with the weight on energy.",
            not_always(weighted("reference_energy"), CELLS, FALLS),
        ),
        Claim(
            "weight-both-trade-off",
            "Section IV-C.1, Fig. 9",
            "With J1-4, too, degradation does not follow cooling energy as the ratio of the weights changes.",
            not_always(weighted("reference_energy_aging"), CELLS, FALLS),
        ),
        Claim(
            "weight-aging-little",
            "Section IV-C.1, Fig. 9",
            "With J1,2,4, emphasising the aging term brings no substantial improvement.",
            spread(
                {"four weights of J1,2,4": weighted("reference_aging")},
                (TRACTION, *CELLS),
                at_most=0.03,
            ),
        ),
        Claim(
            "weight-vice-traction",
            "Section IV-C.1, Fig. 9",
            (
                "With the vice benchmark, a larger ratio of aging to energy weight significantly reduces "
                "traction energy."
            ),
            trend(weighted("energy_aging"), {TRACTION: FALLS}, 0.01),
        ),
        Claim(
            "weight-vice-degradation",
            "Section IV-C.1, Fig. 9",
            "With the vice benchmark, degradation does not always follow the traction energy.",
            not_always(weighted("energy_aging"), CELLS, FALLS),
        ),
        Claim(
            "weight-vice-trade-off",
            "Section IV-C.1, Fig. 9",
            "With the vice benchmark, lower ratios decrease cooling energy at the cost of more degradation.",
            trend(
                weighted("energy_aging"),
                {COOLING: RISES, CELL_1: FALLS, CELL_N: FALLS},
                every_step=False,
            ),
        ),
        Claim(
            "weight-sensitive",
            "Section IV-C.1",
            (
                "The performance of the conventional strategies and the vice benchmark is highly sensitive "
                "to the weights."
            ),
            spread(
                {
                    "J1-3": weighted("reference_energy"),
                    "J1-4": weighted("reference_energy_aging"),
                    "J3+J4": weighted("energy_aging"),
                },
                FOUR,
                at_least=0.05,
            ),
        ),
        Claim(
            "weight-none-reaches-proposed",
            "Section IV-C.1",
            "Whatever the weights, the gains stay modest compared with the proposed strategy.",
            all_lower(
                (PROPOSED,),
                tuple(run for strategy in WEIGHTED for run in weighted(strategy)),
                CELLS,
            ),
        ),
    ),
)

HORIZON = ClaimTopic(
    "Prediction horizon",
    (
        Claim(
            "horizon-saves",
            "Section IV-C.2, Fig. 10",
            "A longer horizon significantly reduces traction energy and degradation.",
            trend(horizons(5, 10, 15, 20), {TRACTION: FALLS, CELL_1: FALLS, CELL_N: FALLS}, 0.01),
        ),
        Claim(
            "horizon-cooling",
            "Section IV-C.2, Fig. 10",
            "The energy for cooling tends to rise with the horizon.",
            trend(horizons(5, 10, 15, 20), {COOLING: RISES}),
        ),
        Claim(
            "horizon-computing",
            "Section IV-C.2, Fig. 10",
            "A longer horizon comes with a considerably higher computational footprint.",
            trend(horizons(5, 10, 15, 20), {COMPUTING_TIME: RISES}, 0.5),
        ),
        Claim(
            "horizon-sensitive",
            "Section IV-C.2",
            "The proposed strategy is highly sensitive to the prediction horizon.",
            spread({"four horizons": horizons(5, 10, 15, 20)}, FOUR, at_least=0.05),
        ),
        Claim(
            "horizon-5-least-cooling",
            "Section IV-C.2, Fig. 10",
            "With a horizon of 5 s the strategy uses the least energy for cooling.",
            all_lower(horizons(5), horizons(10, 15, 20), (COOLING,)),
        ),
        Claim(
            "horizon-5-limit",
            "Section IV-C.2, Fig. 11",
            "With 5 s the temperature of cell N is barely kept within the constraints.",
            value_between("prediction_horizon/5", CELL_N_MAX, lowest=39.0, highest=40.05),
        ),
        Claim(
            "horizon-5-worse-than-reference",
            "Section IV-C.2",
            "With 5 s the degradation is significantly higher than under the benchmark.",
            all_lower((REFERENCE,), horizons(5), CELLS),
        ),
        Claim(
            "horizon-heats-in-demand",
            "Section IV-C.2, Fig. 11",
            (
                "Between 2000 and 2800 s, at high traction demand, the temperatures of both cells rise "
                "substantially."
            ),
            heats_in_demand(horizons(5, 10, 15, 20), length_s=800.0, least_rise_k=1.0),
        ),
        Claim(
            "horizon-cooled-before",
            "Section IV-C.2, Fig. 11",
            "With at least 10 s, the temperature is significantly reduced before the high demand begins.",
            cooled_before_demand(horizons(10, 15, 20), length_s=800.0, least_drop_k=2.0),
        ),
        Claim(
            "horizon-20-coldest",
            "Section IV-C.2, Fig. 11",
            "The temperatures are lowest with the longest horizon.",
            all_lower(horizons(20), horizons(5, 10, 15), MEAN_TEMPERATURES),
            note=(
                'The printed sentence names the horizon "a N_p1 prediction horizon"; as it is compared with'
                " 15 s, it is read as 20 s."
            ),
        ),
        Claim(
            "horizon-20-less-cooling",
            "Section IV-C.2",
            "The longest horizon needs less energy for cooling than 15 s.",
            all_lower(horizons(20), horizons(15), (COOLING,)),
        ),
    ),
)

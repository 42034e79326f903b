"""The paper's statements about the sensitivity to weights, prediction horizon, and multi-horizon grids."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.numbers import changes_in_range, value_between
from iptm_reproduction.checks.orders import all_lower, best_choice
from iptm_reproduction.checks.trends import (
    FALLS,
    RISES,
    levels_off,
    not_always,
    spread,
    trend,
    trend_in_groups,
)
from iptm_reproduction.checks.trips import cooled_before_demand, heats_in_demand
from iptm_reproduction.printed import LENGTH_RANGES
from iptm_reproduction.runs import (
    HORIZONS_S,
    LONG_STEP_COUNTS,
    LONG_STEPS_S,
    PROPOSED,
    REFERENCE,
    SHORT_STEP_COUNTS,
    SPLITS,
    WEIGHTED,
    horizons,
    lengthened,
    sampled,
    weighted,
)

WEIGHTS = ClaimTopic(
    "Weighting sensitivity",
    (
        Claim(
            "weight-energy-saves",
            "Section IV-C.1, Fig. 9",
            "With J1-3, a larger weight on energy significantly reduces both cooling and traction energy.",
            trend(weighted("reference_energy"), {fig.COOLING: FALLS, fig.TRACTION: FALLS}, 0.01),
        ),
        Claim(
            "weight-energy-degradation",
            "Section IV-C.1, Fig. 9",
            "With J1-3, degradation does not always decrease with the weight on energy.",
            not_always(weighted("reference_energy"), fig.CELLS, FALLS),
        ),
        Claim(
            "weight-both-trade-off",
            "Section IV-C.1, Fig. 9",
            "With J1-4, too, degradation does not follow cooling energy as the ratio of the weights changes.",
            not_always(weighted("reference_energy_aging"), fig.CELLS, FALLS),
        ),
        Claim(
            "weight-aging-little",
            "Section IV-C.1, Fig. 9",
            "With J1,2,4, emphasising the aging term brings no substantial improvement.",
            spread(
                {"four weights of J1,2,4": weighted("reference_aging")},
                (fig.TRACTION, *fig.CELLS),
                at_most=0.03,
            ),
        ),
        Claim(
            "weight-vice-traction",
            "Section IV-C.1, Fig. 9",
            "With the vice benchmark, a larger ratio of aging to energy weight significantly reduces "
            "traction energy.",
            trend(weighted("energy_aging"), {fig.TRACTION: FALLS}, 0.01),
        ),
        Claim(
            "weight-vice-degradation",
            "Section IV-C.1, Fig. 9",
            "With the vice benchmark, degradation does not always follow the traction energy.",
            not_always(weighted("energy_aging"), fig.CELLS, FALLS),
        ),
        Claim(
            "weight-vice-trade-off",
            "Section IV-C.1, Fig. 9",
            "With the vice benchmark, lower ratios decrease cooling energy at the cost of more degradation.",
            trend(
                weighted("energy_aging"),
                {fig.COOLING: RISES, fig.CELL_1: FALLS, fig.CELL_N: FALLS},
                every_step=False,
            ),
        ),
        Claim(
            "weight-sensitive",
            "Section IV-C.1",
            "The performance of the conventional strategies and the vice benchmark is highly sensitive "
            "to the weights.",
            spread(
                {
                    "J1-3": weighted("reference_energy"),
                    "J1-4": weighted("reference_energy_aging"),
                    "J3+J4": weighted("energy_aging"),
                },
                fig.FOUR,
                at_least=0.05,
            ),
        ),
        Claim(
            "weight-none-reaches-proposed",
            "Section IV-C.1",
            "Whatever the weights, the gains stay modest compared with the proposed strategy.",
            all_lower(
                (PROPOSED,),
                weighted(*WEIGHTED),
                fig.CELLS,
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
            trend(
                horizons(*HORIZONS_S),
                {fig.TRACTION: FALLS, fig.CELL_1: FALLS, fig.CELL_N: FALLS},
                0.01,
            ),
        ),
        Claim(
            "horizon-cooling",
            "Section IV-C.2, Fig. 10",
            "The energy for cooling tends to rise with the horizon.",
            trend(horizons(*HORIZONS_S), {fig.COOLING: RISES}),
        ),
        Claim(
            "horizon-computing",
            "Section IV-C.2, Fig. 10",
            "A longer horizon comes with a considerably higher computational footprint.",
            trend(horizons(*HORIZONS_S), {fig.COMPUTING_TIME: RISES}, 0.5),
        ),
        Claim(
            "horizon-sensitive",
            "Section IV-C.2",
            "The proposed strategy is highly sensitive to the prediction horizon.",
            spread({"four horizons": horizons(*HORIZONS_S)}, fig.FOUR, at_least=0.05),
        ),
        Claim(
            "horizon-5-least-cooling",
            "Section IV-C.2, Fig. 10",
            "With a horizon of 5 s the strategy uses the least energy for cooling.",
            all_lower(horizons(5), horizons(10, 15, 20), (fig.COOLING,)),
        ),
        Claim(
            "horizon-5-limit",
            "Section IV-C.2, Fig. 11",
            "With 5 s the temperature of cell N is barely kept within the constraints.",
            value_between("prediction_horizon/5", fig.CELL_N_MAX, lowest=39.0, highest=40.05),
        ),
        Claim(
            "horizon-5-worse-than-reference",
            "Section IV-C.2",
            "With 5 s the degradation is significantly higher than under the benchmark.",
            all_lower((REFERENCE,), horizons(5), fig.CELLS),
        ),
        Claim(
            "horizon-heats-in-demand",
            "Section IV-C.2, Fig. 11",
            "Between 2000 and 2800 s, at high traction demand, the temperatures of both cells rise "
            "substantially.",
            heats_in_demand(horizons(*HORIZONS_S), length_s=800.0, least_rise_k=1.0),
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
            all_lower(horizons(20), horizons(5, 10, 15), fig.MEAN_TEMPERATURES),
            note='The printed sentence names the horizon "a N_p1 prediction horizon"; as it is compared with'
            " 15 s, it is read as 20 s.",
        ),
        Claim(
            "horizon-20-less-cooling",
            "Section IV-C.2",
            "The longest horizon needs less energy for cooling than 15 s.",
            all_lower(horizons(20), horizons(15), (fig.COOLING,)),
        ),
    ),
)


BY_SPLIT = {split: sampled(split) for split in SPLITS}
BY_STEP = {
    f"{step} s": tuple(f"sampling_time/{split}/{step}" for split in SPLITS) for step in LONG_STEPS_S
}
FIVE_SECONDS_BY_SPLIT = {
    f"N_p1 = {split.partition('+')[0]}": (f"sampling_time/{split}/5",) for split in SPLITS
}
BY_SHORT_STEPS = {f"N_p1 = {count}": lengthened(count) for count in SHORT_STEP_COUNTS}


def _in_printed_range(
    name: str, figure: Figure, what: str, verb: str = "outperforms", note: str = ""
) -> Claim:
    low, high = sorted(100.0 * abs(change) for change in LENGTH_RANGES[figure])
    statement = f"MH-MPC {verb} SH-MPC by {low:.4g} to {high:.4g} % in {what}."
    runs = lengthened(*SHORT_STEP_COUNTS)
    check = changes_in_range(runs, PROPOSED, figure, *LENGTH_RANGES[figure])
    return Claim(name, "Section IV-D.2", statement, check, note)


SAMPLING_TIME = ClaimTopic(
    "Multi-horizon sampling time",
    (
        Claim(
            "step-cooling",
            "Section IV-D.1, Fig. 12",
            "A longer sampling time of the long horizon leads to more cooling energy in all combinations.",
            trend_in_groups(BY_SPLIT, fig.COOLING, RISES),
        ),
        Claim(
            "step-traction",
            "Section IV-D.1, Fig. 12",
            "In most cases traction energy rises with the sampling time.",
            trend_in_groups(BY_SPLIT, fig.TRACTION, RISES, needed_share=0.6),
        ),
        Claim(
            "step-degradation",
            "Section IV-D.1, Fig. 12",
            "In most cases degradation rises with the sampling time.",
            trend_in_groups(BY_SPLIT, fig.DEGRADATION, RISES, needed_share=0.6),
        ),
        Claim(
            "step-5-best",
            "Section IV-D.1, Fig. 12",
            "The best sampling time of the long horizon is 5 s, with the best degradation.",
            best_choice(BY_STEP, ("5 s",), fig.DEGRADATION),
        ),
        Claim(
            "step-mh-beats-sh",
            "Section IV-D.1, Fig. 12",
            "MH-MPC gives lower degradation than SH-MPC in every combination of horizons and sampling times.",
            all_lower(sampled(*SPLITS), (PROPOSED,), fig.CELLS),
        ),
        Claim(
            "step-3-best-split",
            "Section IV-D.2, Fig. 12",
            "The best balance is achieved with N_p1 = 3, the second best with N_p1 = 5.",
            best_choice(FIVE_SECONDS_BY_SPLIT, ("N_p1 = 3", "N_p1 = 5"), fig.DEGRADATION),
        ),
    ),
)

LENGTH = ClaimTopic(
    "Multi-horizon length",
    (
        Claim(
            "length-computing",
            "Section IV-D.2, Fig. 13",
            "Computing time rises significantly with N_p2.",
            trend_in_groups(BY_SHORT_STEPS, fig.COMPUTING_TIME, RISES),
        ),
        Claim(
            "length-traction",
            "Section IV-D.2, Fig. 13",
            "Traction energy is slightly reduced as N_p2 increases.",
            trend_in_groups(BY_SHORT_STEPS, fig.TRACTION, FALLS),
        ),
        Claim(
            "length-degradation",
            "Section IV-D.2, Fig. 13",
            "Degradation of both cells is slightly reduced as N_p2 increases.",
            trend_in_groups(BY_SHORT_STEPS, fig.DEGRADATION, FALLS),
        ),
        Claim(
            "length-levels-off",
            "Section IV-D.2, Fig. 13",
            "The marginal benefit in degradation diminishes as the prediction horizon lengthens.",
            levels_off(BY_SHORT_STEPS, LONG_STEP_COUNTS, fig.CELLS),
        ),
        _in_printed_range(
            "length-cooling-range",
            fig.COOLING,
            "cooling energy",
            "differs from",
            note="Printed as an improvement. The paper's own numbers show the opposite: the cooling energy of"
            " MH 3+5 relative to the benchmark and that of SH 15 in its table give an increase of "
            "exactly the lower end of the range. It is read as an increase.",
        ),
        _in_printed_range("length-traction-range", fig.TRACTION, "traction energy"),
        _in_printed_range("length-cell-1-range", fig.CELL_1, "the degradation of cell 1"),
        _in_printed_range("length-cell-n-range", fig.CELL_N, "the degradation of cell N"),
        _in_printed_range(
            "length-inconsistency-range", fig.INCONSISTENCY, "the degradation inconsistency"
        ),
    ),
)

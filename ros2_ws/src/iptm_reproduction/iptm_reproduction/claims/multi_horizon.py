"""What the paper says about multi-horizon grids: sampling time and length of the long horizon."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.numbers import changes_in_range
from iptm_reproduction.checks.orders import all_lower, best_choice
from iptm_reproduction.checks.trends import FALLS, RISES, levels_off, trend_in_groups
from iptm_reproduction.figures import (
    CELL_1,
    CELL_N,
    CELLS,
    COMPUTING_TIME,
    COOLING,
    DEGRADATION,
    INCONSISTENCY,
    TRACTION,
)
from iptm_reproduction.printed import LENGTH_RANGES
from iptm_reproduction.runs import (
    LONG_STEP_COUNTS,
    LONG_STEPS_S,
    PROPOSED,
    SHORT_STEP_COUNTS,
    SPLITS,
    lengthened,
    sampled,
)

BY_SPLIT = {split: sampled(split) for split in SPLITS}
BY_STEP = {
    f"{step} s": tuple(f"sampling_time/{split}/{step}" for split in SPLITS) for step in LONG_STEPS_S
}
FIVE_SECONDS_BY_SPLIT = {
    f"N_p1 = {split.partition('+')[0]}": (f"sampling_time/{split}/5",) for split in SPLITS
}
BY_SHORT_STEPS = {f"N_p1 = {count}": lengthened(count) for count in SHORT_STEP_COUNTS}


def _in_printed_range(name: str, figure: Figure, statement: str, note: str = "") -> Claim:
    runs = tuple(run for series in BY_SHORT_STEPS.values() for run in series)
    check = changes_in_range(runs, PROPOSED, figure, *LENGTH_RANGES[figure])
    return Claim(name, "Section IV-D.2", statement, check, note)


SAMPLING_TIME = ClaimTopic(
    "Multi-horizon sampling time",
    (
        Claim(
            "step-cooling",
            "Section IV-D.1, Fig. 12",
            "A longer sampling time of the long horizon leads to more cooling energy in all combinations.",
            trend_in_groups(BY_SPLIT, COOLING, RISES),
        ),
        Claim(
            "step-traction",
            "Section IV-D.1, Fig. 12",
            "In most cases traction energy rises with the sampling time.",
            trend_in_groups(BY_SPLIT, TRACTION, RISES, needed_share=0.6),
        ),
        Claim(
            "step-degradation",
            "Section IV-D.1, Fig. 12",
            "In most cases degradation rises with the sampling time.",
            trend_in_groups(BY_SPLIT, DEGRADATION, RISES, needed_share=0.6),
        ),
        Claim(
            "step-5-best",
            "Section IV-D.1, Fig. 12",
            "The best sampling time of the long horizon is 5 s, with the best degradation.",
            best_choice(BY_STEP, ("5 s",), DEGRADATION),
        ),
        Claim(
            "step-mh-beats-sh",
            "Section IV-D.1, Fig. 12",
            "MH-MPC gives lower degradation than SH-MPC in every combination of horizons and sampling times.",
            all_lower(tuple(run for split in SPLITS for run in sampled(split)), (PROPOSED,), CELLS),
        ),
        Claim(
            "step-3-best-split",
            "Section IV-D.2, Fig. 12",
            "The best balance is achieved with N_p1 = 3, the second best with N_p1 = 5.",
            best_choice(FIVE_SECONDS_BY_SPLIT, ("N_p1 = 3", "N_p1 = 5"), DEGRADATION),
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
            trend_in_groups(BY_SHORT_STEPS, COMPUTING_TIME, RISES),
        ),
        Claim(
            "length-traction",
            "Section IV-D.2, Fig. 13",
            "Traction energy is slightly reduced as N_p2 increases.",
            trend_in_groups(BY_SHORT_STEPS, TRACTION, FALLS),
        ),
        Claim(
            "length-degradation",
            "Section IV-D.2, Fig. 13",
            "Degradation of both cells is slightly reduced as N_p2 increases.",
            trend_in_groups(BY_SHORT_STEPS, DEGRADATION, FALLS),
        ),
        Claim(
            "length-levels-off",
            "Section IV-D.2, Fig. 13",
            "The marginal benefit in degradation diminishes as the prediction horizon lengthens.",
            levels_off(BY_SHORT_STEPS, LONG_STEP_COUNTS, CELLS),
        ),
        _in_printed_range(
            "length-cooling-range",
            COOLING,
            "MH-MPC differs from SH-MPC by 6.35 to 8.26 % in cooling energy.",
            note=(
                "Printed as an improvement. The paper's own numbers say the opposite: the cooling energy of"
                " MH 3+5 relative to the benchmark and that of SH 15 in its table give an increase of "
                "exactly the lower end of the range. It is read as an increase."
            ),
        ),
        _in_printed_range(
            "length-traction-range",
            TRACTION,
            "MH-MPC outperforms SH-MPC by 1.58 to 2.76 % in traction energy.",
        ),
        _in_printed_range(
            "length-cell-1-range",
            CELL_1,
            "MH-MPC outperforms SH-MPC by 11.12 to 13.13 % in the degradation of cell 1.",
        ),
        _in_printed_range(
            "length-cell-n-range",
            CELL_N,
            "MH-MPC outperforms SH-MPC by 11 to 12.84 % in the degradation of cell N.",
        ),
        _in_printed_range(
            "length-inconsistency-range",
            INCONSISTENCY,
            "MH-MPC outperforms SH-MPC by 6.57 to 8.92 % in the degradation inconsistency.",
        ),
    ),
)

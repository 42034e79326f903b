"""The paper's statements about its headline, aging model, strategies and the trip under them."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction import figures as fig
from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.aging_model import aging_exponential, aging_falls
from iptm_reproduction.checks.numbers import (
    change,
    changes_in_range,
    reduction_at_least,
    value,
    value_between,
)
from iptm_reproduction.checks.orders import all_lower, between, rank
from iptm_reproduction.checks.trends import spread
from iptm_reproduction.checks.trips import (
    cools_off_peak,
    last_cell_falls_slower,
    lower_peaks,
    power_regions,
    settles_near,
    traction_dominates,
)
from iptm_reproduction.printed import (
    HEADLINE_CHANGES,
    HEADLINE_WHERE,
    SMALLEST_MARGIN_M,
    printed_change,
)
from iptm_reproduction.runs import (
    MULTI_HORIZON,
    PROPOSED,
    REF_AGING,
    REF_ENERGY,
    REF_ENERGY_AGING,
    REFERENCE,
    STRATEGIES,
    VICE,
)

_SUBJECTS = {VICE: "The vice benchmark", PROPOSED: "The proposed strategy", MULTI_HORIZON: "MH 3+5"}


def _reduces(name: str, where: str, run: str, figure: Figure, what: str) -> Claim:
    printed = HEADLINE_CHANGES[figure] if run == MULTI_HORIZON else printed_change(run, figure)
    statement = f"{_SUBJECTS[run]} reduces {what} by {-100.0 * printed:.2f} %."
    return Claim(name, where, statement, change(run, REFERENCE, figure, printed))


HEADLINE = ClaimTopic(
    "Headline comparison",
    (
        Claim(
            "headline-computing-time",
            HEADLINE_WHERE,
            "MH 3+5 with the aging term reduces computing time by 7.18 % compared with the benchmark.",
            change(
                MULTI_HORIZON, REFERENCE, fig.COMPUTING_TIME, HEADLINE_CHANGES[fig.COMPUTING_TIME]
            ),
        ),
        _reduces("headline-cooling", HEADLINE_WHERE, MULTI_HORIZON, fig.COOLING, "cooling energy"),
        _reduces(
            "headline-traction", HEADLINE_WHERE, MULTI_HORIZON, fig.TRACTION, "traction energy"
        ),
        _reduces("headline-total", "Section IV-D.2", MULTI_HORIZON, fig.TOTAL, "total energy"),
        _reduces(
            "headline-cell-1",
            "Section IV-D.2",
            MULTI_HORIZON,
            fig.CELL_1,
            "the degradation of cell 1",
        ),
        _reduces(
            "headline-cell-n",
            "Section IV-D.2",
            MULTI_HORIZON,
            fig.CELL_N,
            "the degradation of cell N",
        ),
        Claim(
            "headline-over-22",
            "Abstract, Conclusion",
            "MH 3+5 reduces battery degradation by over 22 %.",
            reduction_at_least(MULTI_HORIZON, REFERENCE, fig.CELLS, 0.22),
        ),
        _reduces(
            "headline-inconsistency",
            HEADLINE_WHERE,
            MULTI_HORIZON,
            fig.INCONSISTENCY,
            "the degradation inconsistency",
        ),
        Claim(
            "real-time",
            "Section IV-D.2, Conclusion",
            "MH 3+5 is suitable for practical application in real time.",
            value_between(MULTI_HORIZON, fig.LONGEST_SOLVE, highest=1000.0),
        ),
    ),
)

AGING_MODEL = ClaimTopic(
    "Aging model",
    (
        Claim(
            "aging-falls",
            "Section III-C, Fig. 4",
            "Degradation is reduced by lowering either the current or the temperature.",
            aging_falls(),
        ),
        Claim(
            "aging-exponential",
            "Section III-C, Fig. 4",
            "Degradation increases exponentially with current.",
            aging_exponential(temperature_c=30.0, least_excess=0.5),
        ),
        Claim(
            "traction-dominates",
            "Section III-C",
            "The traction current is significantly larger than the compressor and auxiliary currents.",
            traction_dominates(PROPOSED, factor=5.0),
        ),
        Claim(
            "lower-peaks",
            "Introduction (contributions), Section III-C",
            "The proposed strategy works by reducing peak power, to which degradation is most sensitive.",
            lower_peaks(PROPOSED, (REFERENCE, VICE), percentile=99.0),
        ),
    ),
)


STRATEGY_TABLE = ClaimTopic(
    "Strategies",
    (
        Claim(
            "all-formulations-save",
            "Section IV-B.1",
            "All revised formulations reduce cooling energy, traction energy, total energy, and "
            "degradation of both cells.",
            all_lower(STRATEGIES[1:], (REFERENCE,), (*fig.ENERGIES, *fig.CELLS)),
        ),
        Claim(
            "energy-term-beats-aging-term",
            "Section IV-B.1",
            "Adding the energy term J3 to the benchmark improves all metrics more than adding the aging"
            " term J4.",
            all_lower((REF_ENERGY,), (REF_AGING,), fig.TABLE_FIGURES),
        ),
        Claim(
            "both-terms-between",
            "Section IV-B.1",
            "Adding both J3 and J4 to the benchmark gives intermediate improvements between the two.",
            between(REF_ENERGY_AGING, (REF_ENERGY, REF_AGING), fig.TABLE_FIGURES),
        ),
        Claim(
            "vice-beats-conventional",
            "Section IV-B.1",
            "The vice benchmark J3+J4 outperforms all conventional strategies across nearly all metrics.",
            all_lower((VICE,), STRATEGIES[:4], fig.TABLE_FIGURES, needed_share=0.9),
        ),
        Claim(
            "vice-second-best",
            "Section IV-B.2",
            "The vice benchmark achieves the second-best overall performance.",
            rank(VICE, STRATEGIES, (fig.TOTAL, *fig.CELLS), place=2),
        ),
        Claim(
            "proposed-beats-vice",
            "Section IV-B.1",
            "The proposed strategy further reduces energy, degradation and inconsistency compared with "
            "the vice benchmark.",
            all_lower(
                (PROPOSED,), (VICE,), (fig.TRACTION, fig.TOTAL, *fig.CELLS, fig.INCONSISTENCY)
            ),
        ),
        _reduces("vice-total", "Section IV-B.1, Table IV", VICE, fig.TOTAL, "energy"),
        Claim(
            "vice-degradation",
            "Section IV-B.1",
            "The vice benchmark reduces degradation by nearly 5 %.",
            changes_in_range(
                (VICE,),
                REFERENCE,
                fig.DEGRADATION,
                printed_change(VICE, fig.CELL_N),
                printed_change(VICE, fig.CELL_1),
            ),
        ),
        Claim(
            "vice-inconsistency",
            "Section IV-B.1",
            "The vice benchmark reduces the inconsistency by over 9 %.",
            change(VICE, REFERENCE, fig.INCONSISTENCY, printed_change(VICE, fig.INCONSISTENCY)),
        ),
        _reduces("proposed-cooling", "Table IV", PROPOSED, fig.COOLING, "cooling energy"),
        _reduces("proposed-traction", "Table IV", PROPOSED, fig.TRACTION, "traction energy"),
        _reduces("proposed-total", "Section IV-B.1, Table IV", PROPOSED, fig.TOTAL, "total energy"),
        Claim(
            "proposed-degradation",
            "Section IV-B.1",
            "The proposed strategy reduces degradation by more than 12 %.",
            reduction_at_least(PROPOSED, REFERENCE, fig.CELLS, 0.12),
        ),
        _reduces("proposed-cell-1", "Table IV", PROPOSED, fig.CELL_1, "the degradation of cell 1"),
        _reduces("proposed-cell-n", "Table IV", PROPOSED, fig.CELL_N, "the degradation of cell N"),
        _reduces(
            "proposed-inconsistency",
            "Section IV-B.1, Table IV",
            PROPOSED,
            fig.INCONSISTENCY,
            "the degradation inconsistency",
        ),
        Claim(
            "proposed-more-cooling-than-vice",
            "Section IV-B.2",
            "The proposed strategy consumes slightly more cooling energy than the vice benchmark.",
            all_lower((VICE,), (PROPOSED,), (fig.COOLING,)),
        ),
    ),
)


POWER = ClaimTopic(
    "Power",
    (
        Claim(
            "proposed-lowest-power",
            "Section IV-B.2, Fig. 6a",
            "The proposed strategy achieves the lowest average total power of all strategies.",
            all_lower((PROPOSED,), STRATEGIES[:5], (fig.MEAN_POWER,)),
        ),
        Claim(
            "power-regions",
            "Section IV-B.2, Fig. 6a and 6b",
            "Under the proposed strategy the power is distributed more narrowly at high power and "
            "concentrated more in low-power areas.",
            power_regions(PROPOSED, (REFERENCE, VICE), REFERENCE),
        ),
        Claim(
            "vice-comparable-energy",
            "Section IV-B.2",
            "The vice benchmark achieves an energy consumption comparable to the proposed strategy.",
            spread({"total energy of both": (VICE, PROPOSED)}, (fig.TOTAL,), at_most=0.02),
        ),
        Claim(
            "vice-different-degradation",
            "Section IV-B.2",
            "At comparable energy there remains a significant difference between both in degradation.",
            reduction_at_least(PROPOSED, VICE, fig.CELLS, 0.05),
        ),
        Claim(
            "cools-off-peak",
            "Introduction (contributions), Sections III-C and IV-B.2, Fig. 8a",
            "The proposed strategy avoids cooling at high traction power and cools during low traction "
            "power or braking.",
            cools_off_peak(PROPOSED),
        ),
    ),
)

TRIP = ClaimTopic(
    "Temperature and spacing",
    (
        Claim(
            "last-cell-slower",
            "Section IV-B.2, Fig. 7a",
            "The temperature of cell N decreases more gradually than that of cell 1.",
            last_cell_falls_slower(REFERENCE, share=0.63),
        ),
        Claim(
            "reference-coldest",
            "Section IV-B.2, Fig. 7a",
            "Under the benchmark both cells reach the lowest temperatures of all strategies.",
            all_lower((REFERENCE,), STRATEGIES[1:], (fig.CELL_1_MIN, fig.CELL_N_MIN)),
        ),
        Claim(
            "reference-highest-degradation",
            "Section IV-B.2, Fig. 7b",
            "The low temperatures of the benchmark come with the highest degradation.",
            all_lower(STRATEGIES[1:], (REFERENCE,), fig.CELLS),
        ),
        Claim(
            "energy-term-less-degradation",
            "Section IV-B.2, Fig. 7b",
            "Adding energy consumption to the objective, rather than aging alone, leads to greater "
            "reductions in degradation.",
            all_lower((REF_ENERGY,), (REF_AGING,), fig.CELLS),
        ),
        Claim(
            "proposed-cooler-than-vice",
            "Section IV-B.2, Fig. 7a",
            "Under the proposed strategy both cells are cooler than under the vice benchmark.",
            all_lower((PROPOSED,), (VICE,), fig.MEAN_TEMPERATURES),
        ),
        Claim(
            "settles-near-30",
            "Section IV-B.2, Fig. 7a",
            "Under the proposed strategy the temperature stabilises around 30 degrees.",
            settles_near(PROPOSED, printed_c=30.0, tolerance_k=2.0, last_share=0.75),
        ),
        Claim(
            "spacing-safe",
            "Section IV-B.2, Fig. 8b",
            "The spacing remains above the safe threshold at all times.",
            value_between(PROPOSED, fig.GAP_VIOLATIONS, highest=0.0),
        ),
        Claim(
            "spacing-margin",
            "Section IV-B.2, Fig. 8b",
            "The smallest margin to the safe threshold is 5.904 m.",
            value(PROPOSED, fig.SMALLEST_MARGIN, SMALLEST_MARGIN_M, share=0.25, floor=1.0),
        ),
    ),
)

"""What the paper says about powers, temperatures and spacing over the trip."""

from __future__ import annotations

from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.numbers import reduction_at_least, value, value_between
from iptm_reproduction.checks.orders import all_lower
from iptm_reproduction.checks.powers import cools_off_peak, power_regions
from iptm_reproduction.checks.temperatures import last_cell_falls_slower, settles_near
from iptm_reproduction.checks.trends import spread
from iptm_reproduction.figures import (
    CELL_1_MIN,
    CELL_N_MIN,
    CELLS,
    GAP_VIOLATIONS,
    MEAN_POWER,
    MEAN_TEMPERATURES,
    SMALLEST_MARGIN,
    TOTAL,
)
from iptm_reproduction.printed import SMALLEST_MARGIN_M
from iptm_reproduction.runs import PROPOSED, REF_AGING, REF_ENERGY, REFERENCE, STRATEGIES, VICE

POWER = ClaimTopic(
    "Power",
    (
        Claim(
            "proposed-lowest-power",
            "Section IV-B.2, Fig. 6a",
            "The proposed strategy achieves the lowest average total power of all strategies.",
            all_lower((PROPOSED,), STRATEGIES[:5], (MEAN_POWER,)),
        ),
        Claim(
            "power-regions",
            "Section IV-B.2, Fig. 6a and 6b",
            (
                "Under the proposed strategy the power is distributed more narrowly at high power and "
                "concentrated more in low-power areas."
            ),
            power_regions(PROPOSED, (REFERENCE, VICE), REFERENCE),
        ),
        Claim(
            "vice-comparable-energy",
            "Section IV-B.2",
            "The vice benchmark achieves an energy consumption comparable to the proposed strategy.",
            spread({"total energy of both": (VICE, PROPOSED)}, (TOTAL,), at_most=0.02),
        ),
        Claim(
            "vice-different-degradation",
            "Section IV-B.2",
            "At comparable energy there remains a significant difference between both in degradation.",
            reduction_at_least(PROPOSED, VICE, CELLS, 0.05),
        ),
        Claim(
            "cools-off-peak",
            "Introduction (contributions), Sections III-C and IV-B.2, Fig. 8a",
            (
                "The proposed strategy avoids cooling at high traction power and cools during low traction "
                "power or braking."
            ),
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
            all_lower((REFERENCE,), STRATEGIES[1:], (CELL_1_MIN, CELL_N_MIN)),
        ),
        Claim(
            "reference-highest-degradation",
            "Section IV-B.2, Fig. 7b",
            "The low temperatures of the benchmark come with the highest degradation.",
            all_lower(STRATEGIES[1:], (REFERENCE,), CELLS),
        ),
        Claim(
            "energy-term-less-degradation",
            "Section IV-B.2, Fig. 7b",
            (
                "Adding energy consumption to the objective, rather than aging alone, leads to greater "
                "reductions in degradation."
            ),
            all_lower((REF_ENERGY,), (REF_AGING,), CELLS),
        ),
        Claim(
            "proposed-cooler-than-vice",
            "Section IV-B.2, Fig. 7a",
            "Under the proposed strategy both cells are cooler than under the vice benchmark.",
            all_lower((PROPOSED,), (VICE,), MEAN_TEMPERATURES),
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
            value_between(PROPOSED, GAP_VIOLATIONS, highest=0.0),
        ),
        Claim(
            "spacing-margin",
            "Section IV-B.2, Fig. 8b",
            "The smallest margin to the safe threshold is 5.904 m.",
            value(PROPOSED, SMALLEST_MARGIN, SMALLEST_MARGIN_M, share=0.25, floor=1.0),
        ),
    ),
)

"""What the paper says about its table of six strategies."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import Check, Claim, Topic
from iptm_reproduction.checks.numbers import change, changes_in_range, reduction_at_least
from iptm_reproduction.checks.orders import all_lower, between, rank
from iptm_reproduction.figures import (
    CELL_1,
    CELL_N,
    CELLS,
    COOLING,
    DEGRADATION,
    ENERGIES,
    INCONSISTENCY,
    TABLE_FIGURES,
    TOTAL,
    TRACTION,
)
from iptm_reproduction.printed import printed_change
from iptm_reproduction.runs import (
    PROPOSED,
    REF_AGING,
    REF_ENERGY,
    REF_ENERGY_AGING,
    REFERENCE,
    STRATEGIES,
    VICE,
)


def _changes(run: str, figure: Figure) -> Check:
    return change(run, REFERENCE, figure, printed_change(run, figure))


STRATEGY_TABLE = Topic(
    "Strategies",
    (
        Claim(
            "all-formulations-save",
            "Section IV-B.1",
            (
                "All revised formulations reduce cooling energy, traction energy, total energy, and "
                "degradation of both cells."
            ),
            all_lower(STRATEGIES[1:], (REFERENCE,), (*ENERGIES, *CELLS)),
        ),
        Claim(
            "energy-term-beats-aging-term",
            "Section IV-B.1",
            (
                "Adding the energy term J3 to the benchmark improves all metrics more than adding the aging"
                " term J4."
            ),
            all_lower((REF_ENERGY,), (REF_AGING,), TABLE_FIGURES),
        ),
        Claim(
            "both-terms-between",
            "Section IV-B.1",
            "Adding both J3 and J4 to the benchmark gives intermediate improvements between the two.",
            between(REF_ENERGY_AGING, (REF_ENERGY, REF_AGING), TABLE_FIGURES),
        ),
        Claim(
            "vice-beats-conventional",
            "Section IV-B.1",
            "The vice benchmark J3+J4 outperforms all conventional strategies across nearly all metrics.",
            all_lower((VICE,), STRATEGIES[:4], TABLE_FIGURES, needed_share=0.9),
        ),
        Claim(
            "vice-second-best",
            "Section IV-B.2",
            "The vice benchmark achieves the second-best overall performance.",
            rank(VICE, STRATEGIES, (TOTAL, *CELLS), place=2),
        ),
        Claim(
            "proposed-beats-vice",
            "Section IV-B.1",
            (
                "The proposed strategy further reduces energy, degradation and inconsistency compared with "
                "the vice benchmark."
            ),
            all_lower((PROPOSED,), (VICE,), (TRACTION, TOTAL, *CELLS, INCONSISTENCY)),
        ),
        Claim(
            "vice-total",
            "Section IV-B.1, Table IV",
            "The vice benchmark reduces energy by 6.07 %.",
            _changes(VICE, TOTAL),
        ),
        Claim(
            "vice-degradation",
            "Section IV-B.1",
            "The vice benchmark reduces degradation by nearly 5 %.",
            changes_in_range(
                (VICE,),
                REFERENCE,
                DEGRADATION,
                printed_change(VICE, CELL_N),
                printed_change(VICE, CELL_1),
            ),
        ),
        Claim(
            "vice-inconsistency",
            "Section IV-B.1",
            "The vice benchmark reduces the inconsistency by over 9 %.",
            _changes(VICE, INCONSISTENCY),
        ),
        Claim(
            "proposed-cooling",
            "Table IV",
            "The proposed strategy reduces cooling energy by 19.34 %.",
            _changes(PROPOSED, COOLING),
        ),
        Claim(
            "proposed-traction",
            "Table IV",
            "The proposed strategy reduces traction energy by 6.78 %.",
            _changes(PROPOSED, TRACTION),
        ),
        Claim(
            "proposed-total",
            "Section IV-B.1, Table IV",
            "The proposed strategy reduces total energy by 7.32 %.",
            _changes(PROPOSED, TOTAL),
        ),
        Claim(
            "proposed-degradation",
            "Section IV-B.1",
            "The proposed strategy reduces degradation by more than 12 %.",
            reduction_at_least(PROPOSED, REFERENCE, CELLS, 0.12),
        ),
        Claim(
            "proposed-cell-1",
            "Table IV",
            "The proposed strategy reduces the degradation of cell 1 by 12.77 %.",
            _changes(PROPOSED, CELL_1),
        ),
        Claim(
            "proposed-cell-n",
            "Table IV",
            "The proposed strategy reduces the degradation of cell N by 13.96 %.",
            _changes(PROPOSED, CELL_N),
        ),
        Claim(
            "proposed-inconsistency",
            "Section IV-B.1, Table IV",
            "The proposed strategy reduces the degradation inconsistency by 30.36 %.",
            _changes(PROPOSED, INCONSISTENCY),
        ),
        Claim(
            "proposed-more-cooling-than-vice",
            "Section IV-B.2",
            "The proposed strategy consumes slightly more cooling energy than the vice benchmark.",
            all_lower((VICE,), (PROPOSED,), (COOLING,)),
        ),
    ),
)

"""What the paper says about its table of six strategies."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import Claim, ClaimTopic
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

_NAMES = {VICE: "vice benchmark", PROPOSED: "proposed strategy"}


def _reduces(name: str, where: str, run: str, figure: Figure, what: str) -> Claim:
    printed = printed_change(run, figure)
    statement = f"The {_NAMES[run]} reduces {what} by {-100.0 * printed:.2f} %."
    return Claim(name, where, statement, change(run, REFERENCE, figure, printed))


STRATEGY_TABLE = ClaimTopic(
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
        _reduces("vice-total", "Section IV-B.1, Table IV", VICE, TOTAL, "energy"),
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
            change(VICE, REFERENCE, INCONSISTENCY, printed_change(VICE, INCONSISTENCY)),
        ),
        _reduces("proposed-cooling", "Table IV", PROPOSED, COOLING, "cooling energy"),
        _reduces("proposed-traction", "Table IV", PROPOSED, TRACTION, "traction energy"),
        _reduces("proposed-total", "Section IV-B.1, Table IV", PROPOSED, TOTAL, "total energy"),
        Claim(
            "proposed-degradation",
            "Section IV-B.1",
            "The proposed strategy reduces degradation by more than 12 %.",
            reduction_at_least(PROPOSED, REFERENCE, CELLS, 0.12),
        ),
        _reduces("proposed-cell-1", "Table IV", PROPOSED, CELL_1, "the degradation of cell 1"),
        _reduces("proposed-cell-n", "Table IV", PROPOSED, CELL_N, "the degradation of cell N"),
        _reduces(
            "proposed-inconsistency",
            "Section IV-B.1, Table IV",
            PROPOSED,
            INCONSISTENCY,
            "the degradation inconsistency",
        ),
        Claim(
            "proposed-more-cooling-than-vice",
            "Section IV-B.2",
            "The proposed strategy consumes slightly more cooling energy than the vice benchmark.",
            all_lower((VICE,), (PROPOSED,), (COOLING,)),
        ),
    ),
)

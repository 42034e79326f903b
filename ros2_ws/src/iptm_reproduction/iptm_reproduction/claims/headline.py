"""The paper's headline comparison, and what it says about the aging model."""

from __future__ import annotations

from iptm_core.metrics.figures import Figure
from iptm_reproduction.check import Claim, ClaimTopic
from iptm_reproduction.checks.aging_model import aging_exponential, aging_falls
from iptm_reproduction.checks.numbers import change, reduction_at_least, value_between
from iptm_reproduction.checks.powers import lower_peaks, traction_dominates
from iptm_reproduction.figures import (
    CELL_1,
    CELL_N,
    CELLS,
    COMPUTING_TIME,
    COOLING,
    INCONSISTENCY,
    LONGEST_SOLVE,
    TOTAL,
    TRACTION,
)
from iptm_reproduction.printed import HEADLINE_CHANGES
from iptm_reproduction.runs import MULTI_HORIZON, PROPOSED, REFERENCE, VICE

_EVERYWHERE = "Abstract, Section IV-D.2, Conclusion"


def _reduces(name: str, figure: Figure, what: str, where: str = "Section IV-D.2") -> Claim:
    printed = HEADLINE_CHANGES[figure]
    return Claim(
        name,
        where,
        f"MH 3+5 reduces {what} by {-100.0 * printed:.2f} %.",
        change(MULTI_HORIZON, REFERENCE, figure, printed),
    )


HEADLINE = ClaimTopic(
    "Headline comparison",
    (
        Claim(
            "headline-computing-time",
            "Abstract, Section IV-D.2, Conclusion",
            "MH 3+5 with the aging term reduces computing time by 7.18 % compared with the benchmark.",
            change(MULTI_HORIZON, REFERENCE, COMPUTING_TIME, HEADLINE_CHANGES[COMPUTING_TIME]),
        ),
        _reduces("headline-cooling", COOLING, "cooling energy", _EVERYWHERE),
        _reduces("headline-traction", TRACTION, "traction energy", _EVERYWHERE),
        _reduces("headline-total", TOTAL, "total energy"),
        _reduces("headline-cell-1", CELL_1, "the degradation of cell 1"),
        _reduces("headline-cell-n", CELL_N, "the degradation of cell N"),
        Claim(
            "headline-over-22",
            "Abstract, Conclusion",
            "MH 3+5 reduces battery degradation by over 22 %.",
            reduction_at_least(MULTI_HORIZON, REFERENCE, CELLS, 0.22),
        ),
        _reduces(
            "headline-inconsistency", INCONSISTENCY, "the degradation inconsistency", _EVERYWHERE
        ),
        Claim(
            "real-time",
            "Section IV-D.2, Conclusion",
            "MH 3+5 is suitable for practical application in real time.",
            value_between(MULTI_HORIZON, LONGEST_SOLVE, highest=1000.0),
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

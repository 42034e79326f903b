"""How close a result comes to what the paper says."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """Outcome of checking one statement of the paper."""

    REPRODUCED = "reproduced"
    SIGN_ONLY = "reproduced in sign only"
    NOT_REPRODUCED = "not reproduced"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Judgement:
    """A verdict and the figures behind it.

    Attributes:
        verdict: the outcome.
        found: what this project finds, in words and numbers.
        in_print: what the same rule says about the numbers printed in the paper, where they suffice
            to apply it; else empty.
    """

    verdict: Verdict
    found: str
    in_print: str = ""


@dataclass(frozen=True)
class Tolerance:
    """When a number counts as the printed one.

    Attributes:
        share: accepted deviation as a part of the printed number.
        floor: accepted deviation at least, in the unit of the number.
    """

    share: float
    floor: float

    def accepted(self, printed: float) -> float:
        """Largest accepted deviation from a printed number."""
        return max(self.floor, self.share * abs(printed))

    def judge(self, found: float, printed: float) -> Verdict:
        """Compare a number with the printed one.

        Args:
            found: our number.
            printed: the paper's number.

        Returns:
            `NOT_REPRODUCED` for opposite signs, else `REPRODUCED` within the tolerance and `SIGN_ONLY`
            beyond it.
        """
        if found * printed <= 0.0:
            return Verdict.NOT_REPRODUCED
        if abs(found - printed) <= self.accepted(printed):
            return Verdict.REPRODUCED
        return Verdict.SIGN_ONLY


def worst(verdicts: list[Verdict]) -> Verdict:
    """The verdict on a statement with several numbers: that of the least reproduced one."""
    order = list(Verdict)
    return max(verdicts, key=order.index) if verdicts else Verdict.NOT_TESTED

"""How a statement of the paper is checked against stored runs, and what comes of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from iptm_core.metrics.figures import Figure
from iptm_reproduction.figures import labels
from iptm_reproduction.runs import Results

CHANGE_SHARE, CHANGE_FLOOR = 0.25, 0.01
"""A relative change counts as the printed one if it has the same sign and lies within the larger of both: a
quarter of the printed change, one percentage point."""

NO_CAUSE = "No cause has been written down yet."


class Verdict(Enum):
    """Outcome of checking one statement of the paper, best first."""

    REPRODUCED = "reproduced"
    SIGN_ONLY = "reproduced in sign only"
    NOT_REPRODUCED = "not reproduced"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Finding:
    """A verdict and the numbers behind it.

    Attributes:
        verdict: the outcome.
        found: what this project finds, in words and numbers.
        in_print: outcome of the same rule on the numbers printed in the paper, where they suffice
            to apply it; else empty.
    """

    verdict: Verdict
    found: str
    in_print: str = ""


@dataclass(frozen=True)
class Check:
    """How one statement is checked.

    Attributes:
        rule: the check in words, with its tolerances.
        runs: addresses of the runs without which it cannot be applied.
        judge: applies it; called only if each run is there and has each of the figures.
        figures: figures that each of the runs must have.
    """

    rule: str
    runs: tuple[str, ...]
    judge: Callable[[Results], Finding]
    figures: tuple[Figure, ...] = ()

    def apply(self, results: Results) -> Finding:
        """Return the finding; not tested if a run or a figure is missing."""
        lacking = results.lacking(self.runs)
        if lacking:
            return Finding(Verdict.NOT_TESTED, results.missing_text(lacking))
        if any(results.find(run, figure) is None for run in self.runs for figure in self.figures):
            return Finding(Verdict.NOT_TESTED, f"the stored runs lack {labels(self.figures)}")
        return self.judge(results)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Attributes:
        id: short name, key of its cause.
        where: place in the paper.
        statement: the paper's statement, paraphrased.
        check: how it is checked.
        note: remark on how the statement is read; may be empty.
    """

    id: str
    where: str
    statement: str
    check: Check
    note: str = ""


@dataclass(frozen=True)
class ClaimTopic:
    """Statements under one heading."""

    title: str
    claims: tuple[Claim, ...]


@dataclass(frozen=True)
class CheckedClaim:
    """A statement and what the check has found; a cause where it is not simply reproduced."""

    claim: Claim
    finding: Finding
    cause: str

    @property
    def verdict(self) -> Verdict:
        """The outcome."""
        return self.finding.verdict


def graded(holds: bool, in_sign: bool = False) -> Verdict:  # noqa: FBT001, FBT002
    """Return the verdict on a statement that holds, holds in sign only, or does not hold."""
    if holds:
        return Verdict.REPRODUCED
    return Verdict.SIGN_ONLY if in_sign else Verdict.NOT_REPRODUCED


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict on a statement with several numbers: that of the least reproduced one."""
    return max(verdicts, key=list(Verdict).index)


def accepted_deviation(
    printed: float, share: float = CHANGE_SHARE, floor: float = CHANGE_FLOOR
) -> float:
    """Return by how much a number may deviate from the printed one: a share of it, at least the floor."""
    return max(floor, share * abs(printed))


def compared(
    found: float, printed: float, share: float = CHANGE_SHARE, floor: float = CHANGE_FLOOR
) -> Verdict:
    """Compare a number with the printed one.

    Returns:
        `NOT_REPRODUCED` for opposite signs, else `REPRODUCED` within the accepted deviation and
        `SIGN_ONLY` beyond it.
    """
    same_sign = found * printed > 0.0
    close = abs(found - printed) <= accepted_deviation(printed, share, floor)
    return graded(same_sign and close, same_sign)


def check_topic(
    topic: ClaimTopic, results: Results, causes: Mapping[str, str]
) -> tuple[CheckedClaim, ...]:
    """Check every statement of a topic, in its order.

    Args:
        topic: the statements.
        results: the stored runs.
        causes: reasons for differences by claim id.
    """
    checked = []
    for claim in topic.claims:
        finding = claim.check.apply(results)
        differs = finding.verdict in {Verdict.SIGN_ONLY, Verdict.NOT_REPRODUCED}
        checked.append(
            CheckedClaim(claim, finding, causes.get(claim.id, NO_CAUSE) if differs else "")
        )
    return tuple(checked)


def tally(checked: Sequence[CheckedClaim]) -> dict[Verdict, int]:
    """Return the number of statements by verdict, every verdict listed."""
    counts = Counter(entry.verdict for entry in checked)
    return {verdict: counts[verdict] for verdict in Verdict}

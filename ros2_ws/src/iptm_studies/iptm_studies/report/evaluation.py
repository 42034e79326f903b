"""Applies every rule to the stored runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from iptm_studies.report.paper import Claim, PaperClaims
from iptm_studies.report.runs import STUDIES, Results
from iptm_studies.report.verdict import Judgement, Verdict

NO_CAUSE = "No cause has been written down yet."


@dataclass(frozen=True)
class EvaluatedClaim:
    """A statement, its verdict and what stands behind it.

    Attributes:
        claim: what the paper says.
        rule: how it is checked, in words.
        judgement: the verdict and the figures.
        cause: why it differs; empty for a reproduced statement.
    """

    claim: Claim
    rule: str
    judgement: Judgement
    cause: str

    @property
    def verdict(self) -> Verdict:
        """The outcome."""
        return self.judgement.verdict


def evaluate(
    paper: PaperClaims, results: Results, causes: Mapping[str, str]
) -> tuple[EvaluatedClaim, ...]:
    """Check every statement.

    Args:
        paper: the statements.
        results: the stored runs.
        causes: reasons for differences by claim id, numbers filled in.

    Returns:
        One entry per statement, in the order of the file. A statement whose runs are missing is not
        tested.
    """
    printed = paper.printed
    evaluated = []
    for claim in paper.claims:
        missing = results.missing(claim.rule.needs())
        judgement = (
            Judgement(Verdict.NOT_TESTED, missing_text(missing, results))
            if missing
            else claim.rule.judge(results, printed)
        )
        cause = ""
        if judgement.verdict in {Verdict.SIGN_ONLY, Verdict.NOT_REPRODUCED}:
            cause = causes.get(claim.id, NO_CAUSE)
        evaluated.append(EvaluatedClaim(claim, claim.rule.text(printed), judgement, cause))
    return tuple(evaluated)


def missing_text(missing: Sequence[str], results: Results) -> str:
    """Which runs are missing, and why, in words."""
    studies = dict.fromkeys(address.partition("/")[0] for address in missing)
    names = ", ".join(STUDIES.get(study, study) for study in studies)
    shown = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if len(missing) > 3 else "")
    return f"missing runs of {names}: {shown} ({results.why(missing[0])})"


def tally(evaluated: Sequence[EvaluatedClaim]) -> dict[Verdict, int]:
    """Number of statements by verdict, every verdict listed."""
    counts = Counter(entry.verdict for entry in evaluated)
    return {verdict: counts[verdict] for verdict in Verdict}


def by_group(evaluated: Sequence[EvaluatedClaim]) -> dict[str, list[EvaluatedClaim]]:
    """Statements under their headings, in the order of first appearance."""
    groups: dict[str, list[EvaluatedClaim]] = {}
    for entry in evaluated:
        groups.setdefault(entry.claim.group, []).append(entry)
    return groups

"""Share of a quantity that a run saved against another one, how it was made, and whether it may be quoted."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.declaration import TextEnum

NO_PERCENTAGE = "–"
WIDE_POINTS = 2.5
"""Uncertainty of a repeated trip above which the headline is a range."""


class Judgement(TextEnum):
    """Whether a saving may be quoted."""

    JUDGED = "judged"
    TOO_SHORT = "too short to judge"
    LIMIT_BROKEN = "not judged: a hard limit is broken"
    OTHER_TRIP = "not judged: not the same trip"
    LATE = "not judged: ticks in real time were late"
    UNKNOWN = "not judged: the ends cannot be made equal"


class Basis(TextEnum):
    """What a saving was computed from."""

    EQUAL_ENDS = "equal ends"
    REPEATED = "trip repeated until the pack settles"
    BETWEEN = "between equal ends and as driven"


@dataclass(frozen=True)
class SavedShare:
    """Share of a quantity that a run saved against another one, in percent, negative where it lost.

    Attributes:
        stated_percent: by the basis; NaN where it is not known.
        uncertainty_points: of that, in percentage points.
        equal_ends_percent: with both runs brought to the same end; NaN where that is not known.
        as_driven_percent: of the figures of the trip itself; NaN where they are not known.
    """

    judgement: Judgement
    basis: Basis
    stated_percent: float
    uncertainty_points: float
    equal_ends_percent: float
    as_driven_percent: float

    @property
    def percent(self) -> float:
        """The number to quote, NaN where none can be made."""
        return self.stated_percent if self.judgement is Judgement.JUDGED else math.nan

    @property
    def text(self) -> str:
        """The headline, such as ``27.9 % saved``, or the judgement in its place.

        It is a range, such as ``16.1 to 28.9 % saved``, where the pack does not settle.
        """
        if self.judgement is not Judgement.JUDGED:
            return str(self.judgement)
        if self.basis is Basis.REPEATED and self.uncertainty_points > WIDE_POINTS:
            lowest = self.stated_percent - self.uncertainty_points
            return f"{lowest:.1f} to {lowest + 2.0 * self.uncertainty_points:.1f} % saved"
        return saved_text(self.stated_percent)

    @property
    def as_driven(self) -> str:
        """What stands behind the headline: as driven, and where it was made otherwise how, and equal ends."""
        text = f"as driven {saved_text(self.as_driven_percent)}"
        if self.judgement is not Judgement.JUDGED or self.basis is Basis.EQUAL_ENDS:
            return text
        ends = f"equal ends {saved_text(self.equal_ends_percent)}"
        return f"±{self.uncertainty_points:.1f} points, {self.basis}; {ends}; {text}"


def judged_share(
    judgement: Judgement,
    equal_ends: float,
    as_driven: float,
    repeated: tuple[float, float] | None,
    is_unclear: bool,  # noqa: FBT001
) -> SavedShare:
    """Return a saving by equal ends, or where these decide, repeated, else in their middle."""
    apart = 0.5 * abs(equal_ends - as_driven)
    basis, stated, uncertainty = Basis.EQUAL_ENDS, equal_ends, apart
    if judgement is Judgement.JUDGED and repeated is not None and math.isfinite(repeated[0]):
        basis, (stated, uncertainty) = Basis.REPEATED, repeated
    elif judgement is Judgement.JUDGED and is_unclear:
        basis, stated = Basis.BETWEEN, 0.5 * (equal_ends + as_driven)
    if judgement is Judgement.JUDGED and not math.isfinite(stated):
        judgement = Judgement.UNKNOWN
    return SavedShare(judgement, basis, stated, uncertainty, equal_ends, as_driven)


def saved_percent(own: float, other: float) -> float:
    """Return the saving relative to the other value, in percent; NaN where that is zero or unknown."""
    return 100.0 * (1.0 - own / other) if other else math.nan


def saved_text(percent: float) -> str:
    """Return a saving in words, such as ``49.8 % saved``."""
    if not math.isfinite(percent):
        return NO_PERCENTAGE
    amount = f"{abs(percent):.0f}" if abs(percent) >= 100.0 else f"{abs(percent):.1f}"
    return f"{amount} % {'saved' if percent >= 0.0 else 'lost'}"

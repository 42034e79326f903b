"""Trials and what did not hold in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Judged:
    """A trial, what was found in it, and what of that did not hold.

    Attributes:
        name: of the trial, and how it was driven.
        what: the trial in words.
        labels: what tables group it by.
        figures: what was found, by name; a figure that does not exist is left out.
        problems: what did not hold, in words, by the name of the requirement.
        counts: what occurred how often.
    """

    name: str
    what: str
    labels: Mapping[str, str | float] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    problems: Mapping[str, str] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def problem_text(self) -> str:
        """What did not hold, in one line; empty if everything did."""
        return ", ".join(self.problems.values())

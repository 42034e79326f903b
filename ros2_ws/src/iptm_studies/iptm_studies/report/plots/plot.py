"""What a figure of the report is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.runs import Results


@dataclass(frozen=True)
class Plot:
    """A figure that can be drawn from stored runs.

    Attributes:
        key: file name without suffix, and key in the claims file for a figure of the paper.
        title: heading.
        caption: what is shown, in one or two sentences.
        needs: runs without which it cannot be drawn.
        draw: draws it.
        wanted: runs that it shows if they are there.
    """

    key: str
    title: str
    caption: str
    needs: tuple[str, ...]
    draw: Callable[[Results, PaperClaims], Figure]
    wanted: tuple[str, ...] = ()

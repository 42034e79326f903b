"""How well the paper determines what it omits: misfit over each number."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from iptm_reproduction.identification.spread import determined_numbers
from iptm_reproduction.plots.style import LIMIT_COLOUR, SERIES_COLOURS, labelled, new_figure, plot
from iptm_reproduction.runs import Results

_COLUMNS = 4


@plot(
    "Misfit over each number",
    "Every candidate that was driven with reference and proposed strategy: its misfit over each of its "
    "numbers, between the bounds; dark: good fits, red: the identified value. A number is determined where "
    "good fits gather.",
)
def determined(results: Results) -> Figure:
    """Draw the misfit of all candidates over each number."""
    del results
    spread = determined_numbers()
    rows = math.ceil(len(spread.numbers) / _COLUMNS)
    figure, panels = new_figure(1.5 * rows, rows, _COLUMNS, sharey=True)
    good = spread.misfits <= spread.threshold
    for place, (panel, number) in enumerate(zip(panels, spread.numbers, strict=False)):
        values = spread.values[:, place]
        panel.plot(values[~good], spread.misfits[~good], ".", color="#bbbbbb", markersize=4)
        panel.plot(values[good], spread.misfits[good], ".", color=SERIES_COLOURS[1], markersize=6)
        panel.axvline(number.value, color=LIMIT_COLOUR, linewidth=1.0)
        panel.set_xlim(number.unknown.low, number.unknown.high)
        panel.set_ylim(0.0, 3.0 * spread.threshold)
        labelled(panel, number.unknown.key.partition(".")[2].rpartition(".")[2], "")
        panel.xaxis.label.set_fontsize(6.5)
        panel.tick_params(labelsize=6.5)
    for panel in panels[len(spread.numbers) :]:
        panel.set_axis_off()
    return figure

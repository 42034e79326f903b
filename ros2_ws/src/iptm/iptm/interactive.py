"""Panels as a part of a page that can be moved, zoomed and hovered, drawn by plotly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from iptm.panels import Curve, Panel

go = import_module("plotly.graph_objects")  # an extra
_PIXELS_PER_HEIGHT = 150
_SPACE_SHARE = 0.3
"""Of a panel's height, above it for its title and legend."""
_DASHES = {"-": "solid", "--": "dash", ":": "dot"}


def interactive_html(panels: Sequence[Panel]) -> str:
    """Return the panels over one time axis as HTML with all the code that draws them.

    The cursor names the values of all panels; dragging zooms, a double click shows everything again.
    """
    figure = go.Figure()
    heights = np.array([panel.height for panel in panels])
    bottoms = 1.0 - np.cumsum(heights) / heights.sum()
    tops = bottoms + heights * (1.0 - _SPACE_SHARE) / heights.sum()
    for place, panel in enumerate(panels, start=1):
        number = "" if place == 1 else str(place)
        low, high = bottoms[place - 1], tops[place - 1]
        for curve in panel.curves:
            for trace in _traces(curve, panel.unit):
                figure.add_scatter(yaxis=f"y{number}", legend=f"legend{number}", **trace)
        limits = [None if np.isnan(limit) else limit for limit in panel.limits]
        axis = {
            "domain": [max(low, 0.0), high],
            "title": panel.unit,
            **({"type": "log", "dtick": 1} if panel.logarithmic else {}),
            **({} if limits == [None, None] else {"range": limits}),
        }
        legend = {"x": 1.0, "xanchor": "right", "y": high, "yanchor": "bottom"}
        legend |= {"orientation": "h", "traceorder": "normal"}
        figure.update_layout({f"yaxis{number}": axis, f"legend{number}": legend})
        title = {"text": f"<b>{panel.title}</b>", "x": 0.0, "y": high}
        figure.add_annotation(
            title, xref="paper", yref="paper", xanchor="left", yanchor="bottom", showarrow=False
        )
    figure.update_layout(
        template="plotly_white",
        height=round(_PIXELS_PER_HEIGHT * heights.sum()),
        margin={"l": 60, "r": 10, "t": 10, "b": 45},
        hovermode="x unified",
        hoversubplots="axis",
        xaxis={"title": "time (s)", "anchor": f"y{len(panels)}", "showspikes": True},
    )
    text: str = figure.to_html(include_plotlyjs=True, full_html=False)
    return text


def _traces(curve: Curve, unit: str) -> Iterator[dict[str, Any]]:
    """Yield a line or marks; of an area its lower end and what is filled above."""
    along: dict[str, Any] = {
        "x": curve.time_s,
        "mode": "lines",
        "line": {"width": 0, "shape": "vh" if curve.steps else "linear"},
    }
    named = {
        **along,
        "y": curve.values,
        "name": curve.label,
        "showlegend": bool(curve.label),
        "hovertemplate": f"%{{y:.4g}} {unit}",
    }
    if curve.floor is not None:
        yield {**along, "y": curve.floor, "showlegend": False, "hoverinfo": "skip"}
        fill = f"{curve.color}{round(255 * curve.opacity):02x}"
        yield {**named, "fill": "tonexty", "fillcolor": fill}
    elif curve.style in _DASHES:
        line = {"color": curve.color, "width": curve.width, "dash": _DASHES[curve.style]}
        yield {**named, "line": line}
    else:
        symbol, size = ("triangle-down", 8) if curve.style == "v" else ("circle", 3)
        marker = {"color": curve.color, "size": size, "symbol": symbol}
        yield {**named, "mode": "markers", "marker": marker}

"""Pictures of the report by the key that the page gives them, drawn with matplotlib without a display."""

from __future__ import annotations

from iptm_reproduction.plots import bar_plots, line_plots, map_plots, trip_plots
from iptm_reproduction.plots.style import png_bytes
from iptm_reproduction.results import Results

_MODULES = (bar_plots, line_plots, map_plots, trip_plots)


def drawn(key: str, results: Results) -> bytes:
    """Return a picture as a PNG file; every run that it needs must be there.

    Raises:
        StoreError: the file is too large.
    """
    draw = next(found for module in _MODULES if (found := getattr(module, key, None)))
    return png_bytes(draw(results), key)

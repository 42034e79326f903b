"""Texts of the data files: Jinja templates that take numbers from stored runs and from print."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Any

import jinja2

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction import names
from iptm_reproduction.aging import cooling_payback, reproduced_cooling
from iptm_reproduction.names import DASH, change_text
from iptm_reproduction.printed import printed_value
from iptm_reproduction.results import Results
from iptm_reproduction.trips import share_while_braking

_PERCENTILES = (10.0, 90.0)
# The texts are data of this package and end in Markdown, which is not HTML.
_ENVIRONMENT = jinja2.Environment(undefined=jinja2.StrictUndefined)  # noqa: S701


_compiled = cache(_ENVIRONMENT.from_string)


def rendered(template: str, **context: Any) -> str:
    """Return a text with its expressions filled in, and with single spaces only."""
    return re.sub(r"[ \n]+", " ", _compiled(template).render(context)).strip()


def evaluated(expression: str, **context: Any) -> Any:
    """Return the value of an expression."""
    return _ENVIRONMENT.compile_expression(expression, undefined_to_none=False)(context)


def number_texts(results: Results) -> dict[str, Any]:
    """Return what texts are filled in with: functions to numbers with units, runs and figures by name.

    A dash stands for a missing run.
    """

    def value(run: str, figure: str) -> str:
        return FIGURES[figure].with_unit(results.find(run, figure))

    def printed(run: str, figure: str) -> str:
        return FIGURES[figure].with_unit(printed_value(run, figure))

    def change(run: str, base: str, figure: str) -> str:
        return change_text(results.change(run, base, figure))

    def payback(run: str) -> str:
        """Return the range of times after which cooling with drawn power has paid on a trip."""
        found = cooling_payback(results[run], _PERCENTILES) if run in results else None
        if found is None:
            return f"{DASH} s"
        return f"{min(found.times_s.values()):.0f} to {max(found.times_s.values()):.0f} s"

    def braking_share(run: str) -> str:
        """Return the part of the compressor energy that is spent while braking."""
        share = share_while_braking(results[run].trajectory) if run in results else None
        return f"{DASH} %" if share is None else f"{100.0 * share:.1f} %"

    functions: tuple[Callable[..., str], ...] = (value, printed, change, payback, braking_share)
    constants = {name: entry for name, entry in vars(names).items() if name.isupper()}
    return {
        **constants,
        **{function.__name__: function for function in functions},
        "printed_cooling": reproduced_cooling(),
        "results": results,
    }

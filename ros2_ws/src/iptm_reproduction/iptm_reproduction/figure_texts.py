"""Numbers of stored runs as texts with units; a dash stands for a missing run."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.metrics.figures import Figure
from iptm_reproduction.aging import cooling_payback
from iptm_reproduction.figures import DASH, change_text
from iptm_reproduction.printed import printed_value
from iptm_reproduction.quantities import share_while_braking
from iptm_reproduction.runs import Results

_PERCENTILES = (10.0, 90.0)


@dataclass(frozen=True)
class Numbers:
    """Numbers of stored runs as texts with units."""

    results: Results

    def value(self, run: str, figure: Figure) -> str:
        """Return a figure of a run."""
        return figure.with_unit(self.results.find(run, figure))

    def printed(self, run: str, figure: Figure) -> str:
        """Return a figure of a run as the paper's table prints it."""
        return figure.with_unit(printed_value(run, figure))

    def change(self, run: str, base: str, figure: Figure) -> str:
        """Return the relative change of a figure from a base run to a run."""
        return change_text(self.results.change(run, base, figure))

    def payback(self, run: str) -> str:
        """Return the range of times after which cooling with drawn power has paid on a trip."""
        record = self.results.get(run)
        found = None if record is None else cooling_payback(record, _PERCENTILES)
        if found is None:
            return f"{DASH} s"
        times = found.times_s.values()
        return f"{min(times):.0f} to {max(times):.0f} s"

    def braking_share(self, run: str) -> str:
        """Return the part of the compressor energy that is spent while braking."""
        record = self.results.get(run)
        share = None if record is None else share_while_braking(record.trajectory)
        return f"{DASH} %" if share is None else f"{100.0 * share:.1f} %"

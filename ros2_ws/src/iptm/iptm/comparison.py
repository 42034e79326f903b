"""Several runs side by side: one table, one picture, and what differed in their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from iptm.explanation import parts
from iptm.panels import Panel, overlay_panels
from iptm.report import (
    curves_html,
    figures_html,
    html_table,
    outcome_html,
    saving_html,
    write_page,
)
from iptm.run import Run, figure_title
from iptm_core.errors import ScenarioError
from iptm_core.metrics.figures import FIGURES, SAVINGS, WORTH
from iptm_core.metrics.saving import Saving
from iptm_core.metrics.trip_cost import TripCost
from iptm_core.parameters import to_flat_dict
from iptm_core.user_input import shown

if TYPE_CHECKING:
    from iptm.picture import Picture

_LONGEST_LABEL = 60
_IN_PARAMETERS = ("parameter_set", "overrides")
"""Settings that the parameters themselves stand for."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Runs side by side.

    Attributes:
        runs: by label; the first one is what the others are compared with.
    """

    runs: Mapping[str, Run]

    @property
    def table(self) -> pd.DataFrame:
        """The savings, all figures, and what each run is worth, a row each; a column per run.

        Behind each run but the first stands its change in percent. What cannot be judged is NaN. Costs are by
        the prices and the law of the first run.
        """
        first, *others = self.runs
        values = {label: run.figures for label, run in self.runs.items()}
        for label, found in self.savings.items():
            values[label] = {**found.values, **values[label]}
        costs = self.costs
        for label in others:
            values[label][WORTH.key] = costs[first].eur - costs[label].eur
        of_two = [*SAVINGS, WORTH.key]
        table = pd.DataFrame(values, index=[*SAVINGS, *FIGURES, WORTH.key])
        table = table[table.notna().any(axis=1) | table.index.isin(of_two)]
        compared = [key in FIGURES and FIGURES[key].compared for key in table.index]
        for place, label in enumerate(others):
            change = 100.0 * (table[label] / table[first].where(table[first] != 0.0) - 1.0)
            table.insert(2 + 2 * place, f"{label}: change [%]", change.where(compared))
        table.index = pd.Index([figure_title(key) for key in table.index], name="figure")
        return table

    @property
    def savings(self) -> dict[str, Saving]:
        """Savings of every other run against the first one, by label."""
        first, *others = self.runs
        return {label: self.runs[label].saving(self.runs[first]) for label in others}

    @property
    def parts(self) -> pd.DataFrame:
        """What the savings are made of, in percentage points that add up to the saving with equal ends.

        Rows are the parts of energy and ageing, see `iptm_core.metrics.saving_parts`; a column per run but
        the first.
        """
        first, *others = self.runs
        return pd.DataFrame({label: parts(self.runs[label], self.runs[first]) for label in others})

    @property
    def costs(self) -> dict[str, TripCost]:
        """What every run costs by the prices and the law of the first one, by label."""
        use = next(iter(self.runs.values())).aging_use
        return {label: run.cost(use) for label, run in self.runs.items()}

    @property
    def headlines(self) -> list[str]:
        """Savings of every other run, one line each."""
        return [f"{label}: {found.headline}" for label, found in self.savings.items()]

    @property
    def differences(self) -> pd.DataFrame:
        """Settings and parameters that are not the same in all runs, a row each and a column per run."""
        return _differences(self.runs)

    def plot(self) -> Picture:
        """Draw the runs over each other; see `Run.plot`."""
        from iptm.picture import picture  # noqa: PLC0415  matplotlib takes a moment to load

        return picture(self._panels(), self.headlines)

    def _panels(self) -> list[Panel]:
        return overlay_panels({label: run.trajectory for label, run in self.runs.items()})

    def report(self, path: str | Path) -> Path:
        """Write savings, picture, table and differences as one HTML page that needs no other file.

        Raises:
            StoreError: the file exists, or cannot be written.
        """
        first, differences = next(iter(self.runs)), self.differences
        saved = {label: saving_html(first, found) for label, found in self.savings.items()}
        results = "".join(
            f"<h3>{escape(label)}</h3>{saved.get(label, '')}{outcome_html(run)}"
            f"<small>{escape(run.name)}</small>"
            for label, run in self.runs.items()
        )
        sections = {
            "Results": results,
            "What the savings are made of, in percentage points": html_table(
                self.parts.map("{:+.1f}".format)
            ),
            "Over time": curves_html(self._panels(), self.plot),
            "Figures": figures_html({label: run.metrics for label, run in self.runs.items()}),
            "What differs": html_table(differences) if len(differences) else "<p>no setting</p>",
        }
        return write_page(path, "Runs side by side", sections)


def compare(*runs: Run, **labelled: Run) -> Comparison:
    """Compare runs with the first one.

    Args:
        runs: two or more, labelled by the settings in which they differ.
        labelled: runs with labels of your own, after the others.

    Raises:
        ScenarioError: fewer than two runs, or something else than a run.
    """
    given = {**{str(number): run for number, run in enumerate(runs)}, **labelled}
    for name, run in given.items():
        if not isinstance(run, Run):
            raise ScenarioError(
                f"run {name} is {shown(run)}; allowed: what simulate and load return"
            )
    if len(given) < 2:
        raise ScenarioError(f"compare: {len(given)} runs; allowed: two or more")
    differing = _differences(given)
    found: dict[str, Run] = {}
    for name, run in given.items():
        label = name if name in labelled else _label(run, differing[name])
        found[label if label not in found else f"{label} ({name})"] = run
    return Comparison(found)


def _label(run: Run, differing: pd.Series) -> str:
    """Return the choices in which a run differs, or its name where these are too long or none."""
    chosen = [name for name in ("cycle", "strategy", "horizon") if name in differing.index]
    others = [name for name in differing.index if name not in run.settings or not chosen]
    parts = [str(differing[name]) for name in chosen]
    parts += [f"{name}={differing[name]}" for name in others]
    text = ", ".join(parts)
    return text if 0 < len(text) <= _LONGEST_LABEL else run.name


def _differences(runs: Mapping[str, Run]) -> pd.DataFrame:
    columns = {
        label: {**run.settings, **to_flat_dict(run.parameters)} for label, run in runs.items()
    }
    for column in columns.values():
        for name in _IN_PARAMETERS:
            column.pop(name, None)
    names = dict.fromkeys(name for column in columns.values() for name in column)
    rows = {
        name: [column.get(name, "") for column in columns.values()]
        for name in names
        if len({repr(column.get(name, "")) for column in columns.values()}) > 1
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(runs), dtype=object)

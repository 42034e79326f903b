"""Runs as one HTML page that needs nothing else: tables, and pictures inside the page."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iptm_core.errors import StoreError
from iptm_core.metrics.figures import FIGURES, TRIP_FIGURES, figure_values
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.saving import Saving

if TYPE_CHECKING:
    import pandas as pd

    from iptm.panels import Panel
    from iptm.picture import Picture
    from iptm.run import Run
    from iptm_core.metrics.energy_balance import EnergyBalance

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 78rem; margin: 2rem auto; padding: 0 1rem; }
img { max-width: 100%; } h1 { font-size: 1.35rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; } th, td { padding: .15rem .7rem; border-bottom: 1px solid #ddd; }
td { text-align: right; font-variant-numeric: tabular-nums; } th { text-align: left; font-weight: 600; }
th small { display: block; font-weight: 400; color: #666; max-width: 34rem; }
.saved { font-size: 1.6rem; margin: .4rem 0 0; } .saved + small { color: #666; }
"""
_PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{style}</style></head>
<body><h1>{title}</h1>
{body}
</body></html>
"""


def figure_table(runs: Mapping[str, RunMetrics]) -> pd.DataFrame:
    """Return the figures of trips for people: label and unit, three significant digits, and changes.

    Times out of limits are listed where there are any. The figures of decisions are left out.

    Args:
        runs: by the heads of their columns; changes are those against the first one.
    """
    import pandas as pd  # noqa: PLC0415  a second of its own

    values = {label: figure_values(run) for label, run in runs.items()}
    first = next(iter(values.values()))
    columns: dict[str, list[str]] = {}
    shown = [key for key in TRIP_FIGURES if any(_counts(key, each) for each in values.values())]
    for label, of_run in values.items():
        columns[label] = [FIGURES[key].precise_text(of_run.get(key)) for key in shown]
        if of_run is not first:
            changes = relative_changes(of_run, first)
            columns[f"{label}: change"] = [change_text(key, changes) for key in shown]
    return pd.DataFrame(columns, index=[FIGURES[key].title for key in shown])


def figures_html(runs: Mapping[str, RunMetrics]) -> str:
    """Return the table of `figure_table` with the definition of each figure under its label."""
    import pandas as pd  # noqa: PLC0415  a second of its own

    table = figure_table(runs).map(escape)
    about = {figure.title: figure.about for figure in FIGURES.values()}
    table.index = pd.Index(
        [f"{escape(title)}<small>{escape(about[title])}</small>" for title in table.index]
    )
    table.columns = pd.Index([escape(str(name)) for name in table.columns])
    text: Any = table.to_html(border=0, escape=False)
    return str(text)


def saving_html(name: str, saving: Saving) -> str:
    """Return what a run saved against another one: its statement, the first line large."""
    (label, text), *others = saving.lines
    rest = "".join(f"<li>{escape(f'{each}: {line}')}</li>" for each, line in others)
    return (
        f'<p class="saved">{escape(f"{label}: {text}")}</p>'
        f"<small>against {escape(name)}; energy and the paper's law with equal ends</small><ul>{rest}</ul>"
    )


_COLOURS = (
    "#3b6ea5",
    "#d98c3f",
    "#4a9a62",
    "#b5504f",
    "#7d67a8",
    "#8c6d46",
    "#c96f9b",
    "#7f7f7f",
    "#a3a13c",
    "#3d9fb0",
    "#5b5b8f",
)


def energies_html(runs: Mapping[str, EnergyBalance], distances_m: Mapping[str, float]) -> str:
    """Return where the energy of the cells went, a stacked bar per run, in Wh/km.

    Energy that was gained back, as a descent, has no bar; the table below has all values.
    """
    import pandas as pd  # noqa: PLC0415  a second of its own

    per_km = {
        label: {name: joule / 3.6 / distances_m[label] for name, joule in run.uses.items()}
        for label, run in runs.items()
    }
    names = max(per_km.values(), key=len)
    colours = dict(zip(names, _COLOURS, strict=False))
    widest = max(sum(max(each, 0.0) for each in uses.values()) for uses in per_km.values())
    bars = ""
    for label, uses in per_km.items():
        parts = "".join(
            f'<span title="{name}: {value:.1f} Wh/km" style="display:inline-block;height:1.6rem;'
            f'width:{95.0 * value / widest:.2f}%;background:{colours[name]}"></span>'
            for name, value in uses.items()
            if value > 0.0
        )
        bars += f'<div style="white-space:nowrap">{parts}</div><small>{escape(label)}</small>'
    table = pd.DataFrame(per_km, index=list(names)).fillna(0.0).round(1)
    table.loc["all, current times open-circuit voltage"] = table.sum().round(1)
    table.index = pd.Index(
        [
            f'<span style="color:{colour}">■</span> {name}'
            for name, colour in zip(table.index, [*colours.values(), "#000"], strict=True)
        ]
    )
    return f"{bars}{table.to_html(border=0, escape=False)}"


def outcome_lines(metrics: RunMetrics, problems: Sequence[str] = ()) -> list[str]:
    """Return what went wrong in a run: its problems, limits that were broken, and ticks on a fallback."""
    lines = [f"PROBLEM: {problem}" for problem in problems]
    lines += [check.text for check in metrics.broken_limits] or ["no limit broken"]
    decisions = metrics.decisions
    if decisions is not None and decisions.fallbacks:
        lines.append(decisions.fallbacks_text)
    return lines


def outcome_html(run: Run) -> str:
    """Return the lines of `outcome_lines` as a list."""
    lines = outcome_lines(run.metrics, run.problems)
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def relative_changes(own: Mapping[str, float], first: Mapping[str, float]) -> dict[str, float]:
    """Return the relative change of every figure against the first run, as fractions."""
    return {key: value / first[key] - 1.0 for key, value in own.items() if first.get(key)}


def change_text(key: str, changes: Mapping[str, float]) -> str:
    """Return the change of a figure in percent, empty where it is not known or not compared."""
    known = FIGURES[key].compared and key in changes
    return f"{100.0 * changes[key]:+.1f} %" if known else ""


def write_page(path: str | Path, title: str, sections: Mapping[str, str]) -> Path:
    """Write a page to a new file; sections of HTML by their headings.

    Raises:
        StoreError: the file exists, or cannot be written.
    """
    body = "\n".join(f"<h2>{escape(head)}</h2>\n{text}" for head, text in sections.items())
    path = Path(path)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(_PAGE.format(title=escape(title), style=_STYLE, body=body))
    except FileExistsError:
        raise StoreError(f"{path} exists already; allowed: a new file") from None
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror}") from None
    return path


def _counts(key: str, values: Mapping[str, float]) -> bool:
    return bool(values.get(key)) if key.startswith("longest_") else key in values


def html_table(frame: pd.DataFrame) -> str:
    """Return a table; missing values are empty."""
    text: Any = frame.to_html(border=0, na_rep="")
    return str(text)


def curves_html(panels: Sequence[Panel], plot: Callable[[], Picture]) -> str:
    """Return panels that can be moved, zoomed and hovered; without plotly, a picture and how to get them."""
    try:
        from iptm.interactive import interactive_html  # noqa: PLC0415  an extra
    except ModuleNotFoundError:
        data = b64encode(plot().png()).decode("ascii")
        how = "With plotly installed (pip install plotly) the curves can be moved, zoomed and hovered."
        return f'<img alt="curves over time" src="data:image/png;base64,{data}"><p>{how}</p>'
    return interactive_html(panels)


def _energies(runs: Mapping[str, Run]) -> dict[str, str]:
    """Return the section of the energies; none where the heat of the cells is not known."""
    balances = {label: run.energies for label, run in runs.items()}
    driven_m = {label: run.metrics.distance_m for label, run in runs.items()}
    if not all(math.isfinite(each.open_circuit_j) for each in balances.values()) or not all(
        driven_m.values()
    ):
        return {}
    return {"Where the energy of the cells went, in Wh/km": energies_html(balances, driven_m)}


def write_run(
    run: Run, path: str | Path, against: Run | None, panels: Sequence[Panel], *, explained: bool
) -> Path:
    """Write the page of a run; see `Run.report`."""
    import pandas as pd  # noqa: PLC0415  a second of its own

    saved = "" if against is None else saving_html(against.strategy, run.saving(against))
    runs = {"value": run.metrics}
    if against is not None:
        runs = {against.strategy: against.metrics, run.strategy: run.metrics}
    sections = {"Result": saved + outcome_html(run)}
    if explained:
        why = run.explain(against)
        table = html_table(why.table.map("{:+.1f}".format))
        sections["Why, in percentage points"] = f"<p>{escape(why.sentence)}</p>{table}"
    sections |= {
        "Over time": curves_html(panels, partial(run.plot, against)),
        **_energies(
            {"value": run} if against is None else {against.strategy: against, run.strategy: run}
        ),
        "Figures": figures_html(runs),
    }
    if run.settings:
        sections["Settings"] = html_table(pd.DataFrame({"settings": {**run.settings}}))
    if run.warnings:
        sections["Notes"] = html_table(pd.DataFrame({"notes": run.warnings}))
    return write_page(path, run.name, sections)

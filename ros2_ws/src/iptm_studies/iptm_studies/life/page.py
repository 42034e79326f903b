"""The page about capacity over years of use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from iptm_core.aging_laws.cells import AGING_CELLS, Experiments
from iptm_core.markdown import markdown_table
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_studies.life.decisions import START_C as DECIDED_FROM_C
from iptm_studies.life.decisions import Decision
from iptm_studies.life.losses import BAND, DRAWS, LONGEST_YEARS, SERVICE_YEARS, SPREAD, Cause
from iptm_studies.life.own_law import PARKED_H
from iptm_studies.life.table import CONTROLS, MANAGED, OWN_LAW, PAPER, RESISTANCE_YEARS, Row
from iptm_studies.life.trips import DEFAULT, NO_COOLING
from iptm_studies.life.usage import CLIMATES, USAGES
from iptm_studies.life.year import (
    FREE_COOLING_ABOVE_AIR_K,
    FREE_COOLING_FAN_W,
    FREE_COOLING_FROM_K,
    FREE_COOLING_W_K,
)

NOTICE = "<!-- Made by scripts/life from stored runs; do not edit. -->"
_ABOUT = f"""\
Value of temperature control over years: capacity lost after {SERVICE_YEARS:g} years of the same use,
in **percentage points of nominal capacity**, by cause, with the energy that the cooling needs. A year is
composed of closed-loop trips of the paper's car (a 72 kWh pack), parking and charging; trips are driven from
four temperatures of the pack under every control, with the law of a cell at {len(PARKED_H)} prices of a
kelvin, and interpolated between them. Bands are the
{BAND[0]:g} to {BAND[1]:g} % range of {DRAWS} seeded draws: rates vary by {100 * SPREAD.rate:.0f} %,
activation energies by {100 * SPREAD.energy:.0f} % and exponents of time by {100 * SPREAD.exponent:.0f} %
(standard deviations), all controls with the same draws."""
_CONTROLS = f"""\
- **{NO_COOLING}**: production-like driving, no cooling below 40 °C; savings are counted from here.
- **thermostat**: production-like driving, compressor from 33 down to 30 °C while driving.
- **reference**: the paper's reference strategy on 15 steps of 1 s.
- **{DEFAULT}**: the shipped strategy, whose cost uses the paper's law and whose value of a cool pack ends
  with the trip.
- **{OWN_LAW}**: the same strategy with the law of the cell (`aging_law`): the hours after the trip count, at
  the price of the month, and energy has its price.
- **{MANAGED}**: the same, with another target of charging, reached just in time, and a radiator that cools
  the parked pack where it is {FREE_COOLING_ABOVE_AIR_K:g} K warmer than the air and above
  {FREE_COOLING_FROM_K - CELSIUS_ZERO_K:g} °C ({FREE_COOLING_W_K:g} W/K with a fan of
  {FREE_COOLING_FAN_W:g} W: chosen). The controller is set to both."""
_LIFE = f"""\
Losses and savings in percentage points after {SERVICE_YEARS:g} years; calendar loss while charging counts as
parked; energy of cooling in a year and what it does to the range; years until 80 % of the capacity is left
(at most {LONGEST_YEARS:g}). The last column names what lies
outside the experiments behind the law."""
_LIMITS = """\
- With the law of a cell, trips are those of one law at the same price of a kelvin. The first route of the
  decisions is driven with each law itself.
- In a row of trips, every trip is driven as if the pack rested after it.
- A parked pack approaches the air with a time constant of 10 h, without sun; heating is left out.
- The chiller is that of 35 °C of air in all climates. A cool climate makes it cheaper, which the fitted map
  does not show: its coefficient of the air has the opposite sign and hardly counts. Cooling while
  charging counts with a coefficient of performance of 2.4.
- None of the laws contains lithium plating or a knee. Losses of high mileage and of years beyond the storage
  tests (about one year) are extrapolations, worst for NMC811-Si, whose exponent of time is 0.74.
- Savings are differences of the same law and are known better than losses. The order of the cells is that
  of these makes, not of their chemistries."""


@dataclass(frozen=True)
class Findings:
    """What the page shows.

    Attributes:
        command: what makes it.
        rows: the life table.
        decisions: what the strategy does on single trips.
    """

    command: str
    rows: Sequence[Row]
    decisions: Sequence[Decision]


def life_page(found: Findings) -> str:
    """Return the page as Markdown."""
    parts = [
        NOTICE,
        "# Capacity over years of use",
        _ABOUT,
        f"Command: `{found.command}`.",
        "## In short",
        _summary(found),
        "## Controls",
        _CONTROLS,
        "## Energy and range",
        _energy_table(found.rows),
        "## Decisions under each law",
        _decision_table(found.decisions),
        "## Cells and laws",
        _cell_table(),
        "## Life tables",
        _LIFE,
        *_life_tables(found.rows),
        "## Resistance",
        _resistance(found.rows),
        "## Usages and climates",
        "\n".join(f"- **{usage.name}**: {usage.about}." for usage in USAGES),
        "\n".join(f"- **{climate.name}**: {climate.source}." for climate in CLIMATES),
        "## Limits",
        _LIMITS,
    ]
    return "\n\n".join(parts) + "\n"


def _points(share: float, digits: int = 1) -> str:
    return f"{100.0 * share:.{digits}f}".replace("-0.00", "0.00")


def _band(ends: tuple[float, float] | None, digits: int = 1) -> str:
    return "" if ends is None else f" [{_points(ends[0], digits)}, {_points(ends[1], digits)}]"


def _saved(row: Row) -> str:
    return _points(row.saved, 2) + _band(row.saved_band, 2)


def _summary(found: Findings) -> str:
    usage = USAGES[0].name
    by = {(row.climate, row.control, row.cell): row for row in found.rows if row.usage == usage}
    lines = [
        (
            control,
            climate.name,
            *(
                f"{_saved(row)}; {row.more_kwh:.0f}" if row else "–"
                for row in (by.get((climate.name, control, cell)) for cell in (PAPER, *AGING_CELLS))
            ),
        )
        for control in CONTROLS[1:]
        for climate in CLIMATES
    ]
    heads = ["Control", "Climate", f"{PAPER}:", *(f"{name}:" for name in AGING_CELLS)]
    return (
        f"A {usage}, percentage points of capacity saved after {SERVICE_YEARS:g} years against no cooling "
        "below 40 °C, with bands; and what cooling needs beyond that, in kWh a year:\n\n"
        + markdown_table(heads, lines)
    )


def _decision_table(found: Sequence[Decision]) -> str:
    about = (
        f"The default strategy from {DECIDED_FROM_C:g} °C, set to a commuter in {CLIMATES[0].name} in July: "
        "temperature at the end, as the years above interpolate it, energy of the compressor, and the "
        f"percentage points of capacity that such trips save in {SERVICE_YEARS:g} years, two on each working "
        "day, against the same strategy with the paper's law, by the law of the cell. Of ten measured "
        "trips, the first five minutes and means. The savings are upper bounds: every day of the years is "
        "one in July, the next trip is taken not to cool, and they are valued by the model that the "
        "controller optimises."
    )
    lines = [
        (
            one.route,
            one.cell,
            f"{one.end_c:.1f}",
            "–" if one.interpolated_end_c is None else f"{one.interpolated_end_c:.1f}",
            f"{one.cooling_kwh:.3f}",
            "–" if one.saved is None else _points(one.saved, 2),
        )
        for one in found
    ]
    heads = ["Route", "Law", "end, °C:", "interpolated:", "compressor, kWh:", "saved:"]
    return f"{about}\n\n{markdown_table(heads, lines)}"


def _resistance(rows: Sequence[Row]) -> str:
    shown = [row for row in rows if row.resistance is not None and row.usage == USAGES[0].name]
    cells = list(dict.fromkeys(row.cell for row in shown))
    about = (
        f"Growth after {RESISTANCE_YEARS:g} year of a {USAGES[0].name}, as long as the storage tests, in "
        "percent of a new cell. The other laws have none. That of NMC111 goes with the power 1.25 of time: "
        "over years it is not a prediction, and the tables above leave resistance out."
    )
    by = {(row.climate, row.control, row.cell): row.resistance for row in shown}
    lines = [
        (
            climate.name,
            control,
            *(_points(by[climate.name, control, cell] or 0.0) for cell in cells),
        )
        for climate in CLIMATES
        for control in CONTROLS
    ]
    heads = ["Climate", "Control", *(f"{cell}:" for cell in cells)]
    return f"{about}\n\n{markdown_table(heads, lines)}"


def _energy_table(rows: Sequence[Row]) -> str:
    heads = ["Usage", "Climate", "Control", "cooling, kWh a year:", "range by cooling:"]
    lines = [
        (
            row.usage,
            row.climate,
            row.control,
            f"{row.cooling_kwh:.0f}",
            f"{100.0 * row.range_change:+.1f} %",
            f"{100.0 * row.consumption_change:+.1f} %",
        )
        for row in rows
        if row.cell == PAPER
    ]
    about = (
        "Range by cooling is what the compressor takes; consumption includes the way of driving, which the "
        "strategies change, too. Both are compared with no cooling below 40 °C. With the law of a "
        "cell they depend on the cell: the life tables have them."
    )
    return f"{about}\n\n{markdown_table([*heads, 'consumption from the pack:'], lines)}"


def _cell_table() -> str:
    rows = [
        (name, cell.cell, cell.source, _tests(cell.experiments))
        for name, cell in AGING_CELLS.items()
    ]
    return (
        markdown_table(["Name", "Cell", "Source", "Experiments"], rows)
        + "\n\nThe losses of these laws are within 10 % of those of BLAST-Lite 1.1.1 on the same profiles, "
        "and calendar losses within 0.2 percentage points where it takes the same series hour by hour "
        "(`benchmarks/aging_oracle.py`); it averages over days by default, which hides hours of high "
        "charge and gives less. **paper** is the law of the paper: cyclic ageing only."
    )


def _tests(tests: Experiments) -> str:
    return (
        f"storage {_span(tests.calendar_c)} °C, about {tests.days:.0f} days; cycling "
        f"{_span(tests.cycling_c)} °C, depth {_span(tests.depth)}, up to {tests.largest_c_rate_1_h:g}C; "
        f"charge {_span(tests.charge)}"
    )


def _span(ends: tuple[float, float]) -> str:
    return f"{ends[0]:g} to {ends[1]:g}" if ends[0] != ends[1] else f"{ends[0]:g}"


def _life_tables(rows: Sequence[Row]) -> list[str]:
    parts = []
    for usage in USAGES:
        for climate in CLIMATES:
            shown = [row for row in rows if (row.usage, row.climate) == (usage.name, climate.name)]
            heads = ["Cell", "Control", "Loss:", *(f"{cause}:" for cause in Cause), "Saved:"]
            lines = [
                (
                    row.cell,
                    row.control,
                    _points(row.loss, 2) + _band(row.loss_band),
                    *(_points(row.causes[cause], 2) for cause in Cause),
                    _saved(row),
                    f"{row.cooling_kwh:.0f}",
                    f"{100.0 * row.range_change:+.1f} %",
                    f"> {LONGEST_YEARS:g}" if row.years >= LONGEST_YEARS else f"{row.years:.1f}",
                    ", ".join(row.flags) or "–",
                )
                for row in shown
            ]
            title = f"### {usage.name.capitalize()}, {climate.name}"
            table = markdown_table(
                [*heads, "kWh a year:", "range:", "Years to 80 %:", "Outside"], lines
            )
            parts.append(f"{title}\n\n{table}")
    return parts

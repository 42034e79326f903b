"""The rows of the life table: cell, usage, climate and control, with what is lost, saved and spent."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.aging_laws.paper import paper_law
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray
from iptm_studies.life.losses import (
    SERVICE_YEARS,
    Cause,
    band,
    drawn_losses,
    flags,
    losses_by_cause,
    years_to_end,
)
from iptm_studies.life.trips import DEFAULT, DRIVEN_CONTROLS, NO_COOLING, TripMap
from iptm_studies.life.usage import CLIMATES, USAGES, Charging, Climate, Usage
from iptm_studies.life.year import Year, year_of

MANAGED = "default, charging managed"
RESISTANCE_YEARS = 1.0
CONTROLS = (*DRIVEN_CONTROLS, MANAGED)


@dataclass(frozen=True)
class Spent:
    """What a control needs in a year, compared with no cooling below 40 degC.

    Attributes:
        usage: pattern of use.
        climate: place.
        control: control.
        compressor_kwh: energy of the compressor in a year, while driving and while charging.
        more_kwh: the same, beyond that without cooling.
        range_change: change of the range by the part of that which comes from the pack, as a share.
        consumption_change: change of the energy for driving by that and by the way of driving, as a share.
        driving_kwh: energy from the pack in a year.
        distance_km: distance in a year.
    """

    usage: str
    climate: str
    control: str
    compressor_kwh: float
    more_kwh: float
    range_change: float
    consumption_change: float
    driving_kwh: float
    distance_km: float


@dataclass(frozen=True)
class Row:
    """One line of the life table; losses are shares of nominal capacity after `SERVICE_YEARS`.

    Attributes:
        usage: pattern of use.
        climate: place.
        cell: name of the law, `paper` for the paper's.
        control: control.
        causes: loss by cause.
        loss_band: of the loss; None for the paper's law, whose spread is not published.
        saved: less loss than without cooling below 40 degC.
        saved_band: band of that.
        years: until 80 % of the capacity is left.
        resistance: growth of resistance after `RESISTANCE_YEARS`, None where the cell has no law of it.
        flags: quantities outside the experiments behind the law.
    """

    usage: str
    climate: str
    cell: str
    control: str
    causes: Mapping[Cause, float]
    loss_band: tuple[float, float] | None
    saved: float
    saved_band: tuple[float, float] | None
    years: float
    resistance: float | None
    flags: tuple[str, ...]

    @property
    def loss(self) -> float:
        """Loss of all causes."""
        return sum(self.causes.values())


def _charging(usage: Usage, control: str) -> Charging:
    return usage.managed if control == MANAGED else usage.charging


def _in_all_months(trip: TripMap) -> Callable[[int], TripMap]:
    return lambda _: trip


def years_of_use(
    trips: Mapping[tuple[str, str], TripMap],
) -> Iterator[tuple[Usage, Climate, Mapping[str, Year]]]:
    """Yield the years of every usage and climate by control."""
    parameters = load_parameters().values
    for usage in USAGES:
        for climate in CLIMATES:
            years = {}
            for control in CONTROLS:
                driven = DEFAULT if control == MANAGED else control
                trip = trips[usage.cycle, driven]
                charging = _charging(usage, control)
                years[control] = year_of(
                    usage, climate, driven, charging, _in_all_months(trip), parameters
                )
            yield usage, climate, years


def life_table(
    trips: Mapping[tuple[str, str], TripMap],
) -> tuple[Sequence[Row], Sequence[Spent]]:
    """Return all rows and what each control spends."""
    rows: list[Row] = []
    spent: list[Spent] = []
    for usage, climate, years in years_of_use(trips):
        spent += _spent(usage, climate, years)
        rows += _rows(usage, climate, years)
    return rows, spent


def _spent(usage: Usage, climate: Climate, years: Mapping[str, Year]) -> Iterator[Spent]:
    least = years[NO_COOLING]
    for control, year in years.items():
        more_kwh = year.compressor_kwh - least.compressor_kwh
        grid_kwh = year.grid_compressor_kwh - least.grid_compressor_kwh
        yield Spent(
            usage.name,
            climate.name,
            control,
            year.compressor_kwh + year.grid_compressor_kwh,
            more_kwh + grid_kwh,
            least.driving_kwh / (least.driving_kwh + more_kwh) - 1.0,
            (year.driving_kwh / year.distance_km) / (least.driving_kwh / least.distance_km) - 1.0,
            year.driving_kwh,
            year.distance_km,
        )


def _rows(usage: Usage, climate: Climate, years: Mapping[str, Year]) -> Iterator[Row]:
    laws = {"paper": paper_law(load_parameters().values)}
    laws |= {name: cell.law for name, cell in AGING_CELLS.items()}
    for name, law in laws.items():
        cell = AGING_CELLS.get(name)
        drawn: dict[str, FloatArray] = {}
        without = sum(losses_by_cause(law, years[NO_COOLING], SERVICE_YEARS).values())
        for control, year in years.items():
            causes = losses_by_cause(law, year, SERVICE_YEARS)
            if cell is not None:
                drawn[control] = drawn_losses(cell, year)
            grown = cell and cell.resistance
            yield Row(
                usage.name,
                climate.name,
                name,
                control,
                causes,
                band(drawn[control]) if cell else None,
                without - sum(causes.values()),
                band(drawn[NO_COOLING] - drawn[control]) if cell else None,
                years_to_end(law, year),
                sum(losses_by_cause(grown, year, RESISTANCE_YEARS).values()) if grown else None,
                flags(cell, year) if cell else (),
            )

"""The rows of the life table: cell, usage, climate and control, with what is lost, saved and spent."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.aging_laws.law import paper_law
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
from iptm_studies.life.own_law import OwnLaw, priced_trips
from iptm_studies.life.trips import DEFAULT, DRIVEN_CONTROLS, NO_COOLING, TripMap
from iptm_studies.life.usage import CLIMATES, USAGES, Climate, Usage
from iptm_studies.life.year import Year, year_of

PAPER = "paper"
OWN_LAW = "own law"
MANAGED = "own law, managed"
CONTROLS = (*DRIVEN_CONTROLS, OWN_LAW, MANAGED)
RESISTANCE_YEARS = 1.0


@dataclass(frozen=True)
class Row:
    """One line of the life table; losses are shares of nominal capacity after `SERVICE_YEARS`.

    Attributes:
        usage: pattern of use.
        climate: place.
        cell: name of the law, `PAPER` for the paper's.
        control: control.
        causes: loss by cause.
        loss_band: of the loss; None for the paper's law, whose spread is not published.
        saved: less loss than without cooling below 40 degC.
        saved_band: band of that.
        years: until 80 % of the capacity is left.
        resistance: growth of resistance after `RESISTANCE_YEARS`, None where the cell has no law of it.
        flags: quantities outside the experiments behind the law.
        cooling_kwh: energy of compressor and fan in a year, from pack and grid.
        more_kwh: the same, beyond that without cooling below 40 degC.
        range_change: change of the range by the part of that which comes from the pack, as a share.
        consumption_change: change of the energy from the pack, by cooling and way of driving, as a share.
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
    cooling_kwh: float
    more_kwh: float
    range_change: float
    consumption_change: float

    @property
    def loss(self) -> float:
        """Loss of all causes."""
        return sum(self.causes.values())


def _in_all_months(trip: TripMap) -> Callable[[int], TripMap]:
    return lambda _: trip


def life_table(trips: Mapping[tuple[str, str], TripMap]) -> Sequence[Row]:
    """Return all rows, from the trips by cycle and control."""
    rows: list[Row] = []
    parameters = load_parameters().values
    for usage in USAGES:
        for climate in CLIMATES:
            shared = {}
            for control in DRIVEN_CONTROLS:
                trip_of = _in_all_months(trips[usage.cycle, control])
                shared[control] = year_of(
                    usage, climate, control, usage.charging, trip_of, parameters
                )
            rows += _rows(usage, climate, PAPER, shared)
            for cell in AGING_CELLS:
                own = {}
                for control, charging in ((OWN_LAW, usage.charging), (MANAGED, usage.managed)):
                    law = OwnLaw(cell, usage, climate, charging, shared[DEFAULT])
                    trip_of = partial(law.trip, priced_trips(trips, usage.cycle))
                    own[control] = year_of(usage, climate, DEFAULT, charging, trip_of, parameters)
                rows += _rows(usage, climate, cell, shared | own)
    return rows


def _rows(usage: Usage, climate: Climate, name: str, years: Mapping[str, Year]) -> Iterator[Row]:
    cell = AGING_CELLS.get(name)
    law = cell.law if cell else paper_law(load_parameters().values)
    least = years[NO_COOLING]
    without = sum(losses_by_cause(law, least, SERVICE_YEARS).values())
    drawn: dict[str, FloatArray] = {}
    for control, year in years.items():
        causes = losses_by_cause(law, year, SERVICE_YEARS)
        if cell is not None:
            drawn[control] = drawn_losses(cell, year)
        grown = cell and cell.resistance
        more_kwh = year.compressor_kwh - least.compressor_kwh
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
            year.compressor_kwh + year.grid_compressor_kwh,
            more_kwh + year.grid_compressor_kwh - least.grid_compressor_kwh,
            least.driving_kwh / (least.driving_kwh + more_kwh) - 1.0,
            (year.driving_kwh / year.distance_km) / (least.driving_kwh / least.distance_km) - 1.0,
        )

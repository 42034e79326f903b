"""Capacity loss over years of use: by cause, climate and pattern of use, also for a user's own trip.

The bands come from the spread of published parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import pandas as pd

from iptm.climate import DAY_S, HOUR_S, Climate, climate_of
from iptm.run import Run
from iptm_core.aging_laws.cells import AGING_CELLS, AgingCell, outside_experiments
from iptm_core.aging_laws.law import AgingLaw, Mechanism, MechanismLaw
from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.parameters.loading import parse_overrides
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K, SECONDS_PER_DAY
from iptm_core.user_input import check_known, known_keywords, shown
from iptm_life.trip_map import START_C, TripMap, nominal_energy_j, trip_map
from iptm_life.year import USAGES, Activity, Usage, Year, year_of

SERVICE_YEARS = 8.0
END_OF_LIFE = 0.2
LONGEST_YEARS = 40.0
DRAWS = 200
SEED = 27
BAND = (5.0, 95.0)


class Cause(TextEnum):
    """What capacity is lost to, and when."""

    CYCLIC_DRIVING = "cyclic, driving"
    CYCLIC_CHARGING = "cyclic, charging"
    CALENDAR_PARKED = "calendar, parked"
    CALENDAR_DRIVING = "calendar, driving"


SPREAD = {"rate": 0.15, "energy": 0.12, "exponent": 0.1}
"""Relative standard deviations of the parameters of a law.

``rate`` is for all rates between cells and batches, with which BLAST-Lite draws cells. ``energy`` is for
activation energies: of NMC111, 45.6 kJ/mol (Smith et al. 2017) and 58.0 kJ/mol (Schmalstieg et al. 2014)
are 12 % off their mean. ``exponent`` is for the exponent of time, by which loss is extrapolated beyond
the storage tests: chosen, an exponent of 0.5 is then 0.4 to 0.6 in 19 of 20 draws.
"""


def damage_by_cause(law: AgingLaw, year: Year) -> tuple[Mapping[Cause, float], ...]:
    """Return the damage of a year of every mechanism, by cause."""
    return tuple(_by_cause(part, year) for part in law.mechanisms)


def _by_cause(part: MechanismLaw, year: Year) -> Mapping[Cause, float]:
    damage = np.broadcast_to(part.damage_rate_1_s(year.load) * year.duration_s, year.activity.shape)
    driving = year.activity == Activity.DRIVING
    if part.mechanism is Mechanism.CALENDAR:
        split = (Cause.CALENDAR_DRIVING, driving), (Cause.CALENDAR_PARKED, ~driving)
    else:
        split = (Cause.CYCLIC_DRIVING, driving), (Cause.CYCLIC_CHARGING, ~driving)
    return {cause: float(np.sum(damage[rows])) for cause, rows in split}


def losses_by_cause(law: AgingLaw, year: Year, years: float) -> Mapping[Cause, float]:
    """Return the capacity lost after equal years, by cause.

    The loss of a mechanism is divided like its damage: what comes late costs as much as what comes early.
    """
    found = dict.fromkeys(Cause, 0.0)
    for part, damage in zip(law.mechanisms, damage_by_cause(law, year), strict=True):
        total = sum(damage.values())
        if total > 0.0:
            loss = (years * total) ** part.exponent
            for cause, share in damage.items():
                found[cause] += loss * share / total
    return found


def years_to_end(law: AgingLaw, year: Year) -> float:
    """Return the years until `END_OF_LIFE` is lost, at most `LONGEST_YEARS`."""
    totals = [sum(damage.values()) for damage in damage_by_cause(law, year)]

    def lost(years: float) -> float:
        return float(law.capacity_loss([years * total for total in totals]))

    low, high = 0.0, LONGEST_YEARS
    if lost(high) < END_OF_LIFE:
        return high
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if lost(middle) < END_OF_LIFE else (low, middle)
    return high


def drawn_losses(
    cell: AgingCell, year: Year, years: float = SERVICE_YEARS, draws: int = DRAWS, seed: int = SEED
) -> FloatArray:
    """Return losses for parameters drawn from the published spread, the same draws for every year of use.

    Activation energies vary about the middle temperature of the storage tests and exponents about their
    length, where the measurements fix the loss.

    Returns:
        Losses after years of service, shape (draws,).
    """
    random = np.random.default_rng(seed)
    variations = random.standard_normal((draws, 3)) * list(SPREAD.values())
    temperature_k = np.asarray(year.load.temperature_k)
    tests = cell.experiments
    middle_k = 0.5 * sum(tests.calendar_c) + CELSIUS_ZERO_K
    losses = np.zeros(draws)
    for part in cell.law.mechanisms:
        p = part.exponent
        rate = np.broadcast_to(part.damage_rate_1_s(year.load), temperature_k.shape)
        if part.mechanism is not Mechanism.CALENDAR:
            nominal = float(years * np.sum(rate * year.duration_s)) ** p
            losses += nominal * np.maximum(1.0 + variations[:, 0], 0.0)
            continue
        k = (rate * SECONDS_PER_DAY) ** p
        slope = part.damage_slope_1_s_k(year.load)
        energy_k = p * slope * temperature_k**2 / rate
        off = energy_k * (1.0 / middle_k - 1.0 / temperature_k)
        for draw, (scale, energy, exponent) in enumerate(variations):
            q = p * (1.0 + exponent)
            varied = k * max(1.0 + scale, 0.0) * np.exp(energy * off) * tests.days ** (p - q)
            damage = np.sum(varied ** (1.0 / q) * year.duration_s) / SECONDS_PER_DAY
            losses[draw] += (years * damage) ** q
    return losses


def flags(cell: AgingCell, year: Year) -> tuple[str, ...]:
    """Return in which quantities a year of use leaves the experiments behind a law."""
    celsius = np.asarray(year.load.temperature_k) - CELSIUS_ZERO_K
    rests = year.activity == Activity.PARKED
    charge = np.asarray(year.load.charge)
    return outside_experiments(
        cell.experiments,
        _range(celsius[rests]),
        _range(celsius[~rests]),
        _range(charge),
        float(np.max(np.asarray(year.load.depth))),
        float(np.max(np.asarray(year.load.c_rate_1_h))),
    )


def band(values: Sequence[float] | FloatArray) -> tuple[float, float]:
    """Return the ends of the band of drawn values."""
    low, high = np.percentile(values, BAND)
    return float(low), float(high)


def _range(values: FloatArray) -> tuple[float, float]:
    return float(np.min(values)), float(np.max(values))


_PERCENT = 100.0
_INITIAL = "environment.initial_cell_temperature_k"


class YearMaker(Protocol):
    """A pattern of use that makes its year itself."""

    @property
    def name(self) -> str:
        """For tables."""
        ...

    def year(
        self, cell: AgingCell, climate: Climate, trip: TripMap, parameters: ModelParameters
    ) -> Year:
        """Return a year of trips."""
        ...


@dataclass(frozen=True)
class Life:
    """What years of use make of a pack.

    Attributes:
        about: trip, cell, climate and usage, in one line.
        years: of service.
        lost: capacity lost after these years by cause, in percent of nominal.
        lost_band: 5th and 95th percentile of the sum for parameters drawn from their published spread.
        years_to_80_percent: until a fifth of the capacity is lost, at most 40.
        distance_km: driven in a year.
        energy_kwh: drawn from the pack in a year, driving.
        outside: quantities in which the use leaves the experiments behind the ageing law.
        against: the same years with the trip of another run, None without one.
    """

    about: str
    years: float
    lost: pd.Series
    lost_band: tuple[float, float]
    years_to_80_percent: float
    distance_km: float
    energy_kwh: float
    outside: tuple[str, ...]
    against: Life | None = None

    @property
    def sentence(self) -> str:
        """The loss in one sentence."""
        low, high = self.lost_band
        beyond = f"; outside the experiments: {', '.join(self.outside)}" if self.outside else ""
        beside = ""
        if self.against is not None:
            other = self.against.lost.sum()
            saved = other - self.lost.sum()
            compared = "less" if saved >= 0.0 else "more"
            beside = f", {abs(saved):.2f} percentage points {compared} than by the other run ({other:.1f} %)"
        return (
            f"{self.about}: {self.lost.sum():.1f} % of the capacity lost after {self.years:g} years{beside} "
            f"({low:.1f} to {high:.1f} % for the spread of published cells), "
            f"{self.distance_km:.0f} km a year{beyond}"
        )


@known_keywords
def life(
    run: Run,
    *,
    cell: str | AgingCell = "nca",
    climate: str | float | Climate = "Phoenix",
    usage: str | Usage | YearMaker = "commuter",
    years: float = SERVICE_YEARS,
    start_c: Sequence[float] = START_C,
    against: Run | None = None,
) -> Life:
    """Return what years of trips like a run make of the pack: driven, charged and parked.

    The trip is driven again from each start temperature, with the controller of the run; the air around the
    car counts while it is parked; the trips are driven in the air of the run (``climate=`` of
    `simulate`). The paper's law of cyclic ageing does not count here.

    Args:
        run: a run of `iptm.simulate`; vehicle, drive and strategy are taken from its trip.
        cell: whose ageing law counts, by name such as ``nca``, or an `AgingCell`.
        climate: ``Phoenix``, ``Rome``, ``Oslo``, a constant temperature in degC, or a `Climate`.
        usage: ``commuter``, ``taxi``, ``long distance``, a `Usage`, whose cycle does not count, or what makes
            a year itself, such as a plan of the parked hours.
        years: of service.
        start_c: temperatures of the pack at the start of a trip, in degC, at least two, increasing.
        against: run whose years are compared, with the same cell, climate and usage.

    Raises:
        IptmError: a name is unknown, the trip is not known, or the charge does not last for a day.
    """
    if run.trip is None or run.trip.conditions.faults:
        raise ScenarioError("life: the trip is not known or has faults; allowed: a run of simulate")
    aging: AgingCell = _named(cell, AGING_CELLS, "cell")
    air = climate_of(climate)
    driven_c = run.parameters.environment.ambient_temperature_k - CELSIUS_ZERO_K
    habit: Usage | YearMaker = _named(usage, {each.name: each for each in USAGES}, "usage")
    if len(start_c) < 2 or np.any(np.diff(start_c) <= 0.0):
        raise ScenarioError(f"start_c is {shown(start_c)}; allowed: two or more, increasing")
    driven = driven_map(run, start_c)
    if isinstance(habit, Usage):
        _check_day(habit, float(driven.drawn[:, -1].max()), driven.duration_s, run)
        year = year_of(habit, air, run.strategy, [driven] * 12, run.parameters)
    else:
        year = habit.year(aging, air, driven, run.parameters)
    lost = losses_by_cause(aging.law, year, years)
    low, high = band(drawn_losses(aging, year, years))
    same: dict[str, Any] = {"cell": cell, "climate": climate, "usage": usage}
    other = None if against is None else life(against, **same, years=years, start_c=start_c)
    return Life(
        about=f"{run.name}; {aging.law.name}, {air.name} (trips in air of {driven_c:.0f} degC), {habit.name}",
        years=years,
        lost=pd.Series({str(cause): _PERCENT * loss for cause, loss in lost.items()}),
        lost_band=(_PERCENT * low, _PERCENT * high),
        years_to_80_percent=years_to_end(aging.law, year),
        distance_km=year.distance_km,
        energy_kwh=year.driving_kwh,
        outside=flags(aging, year),
        against=other,
    )


_MAPS: WeakKeyDictionary[Run, dict[tuple[float, ...], TripMap]] = WeakKeyDictionary()
"""Trips that were driven again, by run: other parked hours need no other trips."""


def driven_map(run: Run, start_c: Sequence[float] = START_C) -> TripMap:
    """Return the trip of a run driven again from each of some temperatures of the pack, in degC."""
    maps = _MAPS.setdefault(run, {})
    starts = tuple(map(float, start_c))
    if starts not in maps:
        driven = [_driven_from(run, celsius) for celsius in starts]
        maps[starts] = trip_map(driven, nominal_energy_j(run.parameters))
    return maps[starts]


def _driven_from(run: Run, celsius: float) -> Trajectory:
    from iptm.driving import drive_in_memory  # noqa: PLC0415  it takes a moment to load

    if run.trip is None:
        raise AssertionError("a run with a trip is checked for")
    overrides = {**parse_overrides(run.trip.vehicle.overrides), _INITIAL: celsius + CELSIUS_ZERO_K}
    return drive_in_memory(run.trip.changed(overrides=overrides)).trajectory


def _named(given: object, shipped: Mapping[str, Any], what: str) -> Any:
    if not isinstance(given, str):
        return given
    known = {name.lower(): entry for name, entry in shipped.items()}
    check_known(given.lower(), known, "life", what, ScenarioError)
    return known[given.lower()]


def _check_day(usage: Usage, drawn: float, duration_s: float, run: Run) -> None:
    """Refuse a day of which the trips overlap, or empty the pack below its smallest charge."""
    charge = usage.target
    ends_h = [hour + repeats * duration_s / HOUR_S for hour, repeats in usage.departures]
    next_h = [hour for hour, _ in usage.departures[1:]]
    next_h.append(usage.departures[0][0] + DAY_S / HOUR_S)
    for number, (_, repeats) in enumerate(usage.departures):
        charge = max(charge, usage.fast_target) if number else charge
        charge -= repeats * drawn
        if charge < run.parameters.charge.min_charge or ends_h[number] > next_h[number]:
            raise ScenarioError(
                f"usage is {usage.name}: {repeats} trips of {duration_s:.0f} s from "
                f"{usage.departures[number][0]:g} h leave a charge of {charge:.2f}; allowed: trips that end "
                f"before the next drive, with at least {run.parameters.charge.min_charge:g}"
            )

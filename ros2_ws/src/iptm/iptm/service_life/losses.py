"""Capacity lost by years of use, by cause, with bands from the spread of published parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iptm.service_life.year import Activity, Year
from iptm_core.aging_laws.cells import AgingCell, outside_experiments
from iptm_core.aging_laws.law import AgingLaw, Mechanism, MechanismLaw
from iptm_core.declaration import TextEnum
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, SECONDS_PER_DAY

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

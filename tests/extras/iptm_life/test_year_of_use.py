"""Years of use: balances of a day, losses by hand, bands, and what cooling saves, from made-up trips."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from studies.drives import DEFAULT

from iptm.climate import CLIMATES, Climate
from iptm_core.aging_laws.cells import AGING_CELLS, NCA
from iptm_core.aging_laws.law import Load
from iptm_core.parameters import load_parameters
from iptm_life.life import (
    Cause,
    band,
    drawn_losses,
    flags,
    losses_by_cause,
    years_to_end,
)
from iptm_life.trip_map import TripMap
from iptm_life.year import (
    NO_COOLING,
    USAGES,
    Activity,
    Usage,
    Year,
    year_of,
)

PARAMETERS = load_parameters().values
COMMUTER = USAGES[0]
MILD = Climate("mild", "made up", (20.0,) * 12, 0.0)
YEAR_S = 365.25 * 86400.0


def trip(
    warming_k: float,
    *,
    drawn: float = 0.06,
    coolest_k: float = math.inf,
    compressor_j: float = 0.0,
) -> TripMap:
    """Half an hour that draws charge and warms the pack; cooling keeps it at a temperature."""
    start_k = np.array([283.15, 313.15])
    samples = np.arange(1, 7) / 6.0
    kelvin = np.minimum(start_k[:, np.newaxis] + warming_k * samples, coolest_k)
    return TripMap(
        start_k,
        kelvin,
        np.full((2, 6), 0.15),
        np.tile(drawn * samples, (2, 1)),
        kelvin[:, -1],
        np.array([0.0, compressor_j]),
        1800.0,
        20e3,
    )


def commuting(usage: Usage = COMMUTER, warming_k: float = 2.0) -> Year:
    return year_of(usage, MILD, DEFAULT, [trip(warming_k)] * 12, PARAMETERS)


def test_a_year_has_its_days_its_distance_and_its_charge() -> None:
    """Two trips of 20 km and 6 % on five of seven days; what is drawn is charged at 0.1C."""
    year = commuting()
    driving_days = 365.25 * 5.0 / 7.0
    assert np.sum(year.duration_s) == pytest.approx(YEAR_S)
    assert year.distance_km == pytest.approx(40.0 * driving_days)
    driving, charging = (
        float(np.sum(year.duration_s[year.activity == activity])) / driving_days
        for activity in (Activity.DRIVING, Activity.CHARGING)
    )
    assert driving == pytest.approx(3600.0)
    assert charging == pytest.approx(0.12 / 0.1 * 3600.0)
    assert year.driving_kwh == pytest.approx(0.12 * 72.47 * driving_days, rel=1e-3)


def test_a_parked_pack_settles_at_the_air() -> None:
    """Without warmth of trips, nothing but 55 W of charging keeps the pack above the air of 20 degC."""
    year = commuting(warming_k=0.0)
    kelvin = np.asarray(year.load.temperature_k)
    assert np.min(kelvin) == pytest.approx(293.15, abs=0.2)
    assert np.max(kelvin) < 293.15 + 2.0


def test_air_cools_a_parked_pack_by_radiator_and_fan() -> None:
    """Arriving 12 K above the air it falls to 3 K in the time of 80 W that the conductances give."""
    warm, free = (
        commuting(replace(COMMUTER, free_cooling=free), warming_k=12.0) for free in (False, True)
    )
    rests = [np.average(y.load.temperature_k, weights=y.duration_s) for y in (warm, free)]
    assert rests[1] < rests[0] - 1.0
    assert np.average(free.load.temperature_k, weights=free.duration_s) > 293.15
    capacity_j_k = 16 * 6 * 38 * PARAMETERS.cell.heat_capacity_j_k
    trips = 2.0 * 365.25 * 5.0 / 7.0
    cooling_h = math.log(12.0 / 3.0) / (100.0 / capacity_j_k + 1.0 / 36000.0) / 3600.0
    assert free.compressor_kwh == pytest.approx(0.08 * cooling_h * trips, rel=0.3)
    assert warm.compressor_kwh == 0.0


def test_charging_just_in_time_rests_at_a_lower_charge() -> None:
    on_arrival, in_time = (
        commuting(replace(COMMUTER, just_in_time=just_in_time)) for just_in_time in (False, True)
    )
    rests = [
        float(np.average(np.asarray(year.load.charge), weights=year.duration_s))
        for year in (on_arrival, in_time)
    ]
    assert rests[0] - rests[1] > 0.05
    assert np.max(np.asarray(in_time.load.charge)) <= 0.8 + 1e-9


def test_losses_of_a_constant_year_by_hand() -> None:
    """Eight years at 25 degC and half charge, parked: 75.4 exp(-3340 / T + 353 s / T) days^0.512 for NCA."""
    hours = np.full(24, YEAR_S / 24.0)
    at = np.ones(24)
    year = Year(
        hours,
        2.0 * at,
        Load(298.15 * at, 0.0 * at, 0.5 * at, 0.0 * at, 0.0 * at),
        0.0,
        0.0,
        1.0,
        1.0,
    )
    k = 75.4 * math.exp((-3340.0 + 353.0 * 0.5) / 298.15)
    causes = losses_by_cause(NCA.law, year, 8.0)
    assert causes[Cause.CALENDAR_PARKED] == pytest.approx(k * (8.0 * 365.25) ** 0.512)
    assert sum(causes.values()) == causes[Cause.CALENDAR_PARKED]
    assert years_to_end(NCA.law, year) == pytest.approx((0.2 / k) ** (1.0 / 0.512) / 365.25)
    assert flags(NCA, replace(year, activity=np.array([0.0] + 23 * [2.0]))) == (
        "depth of discharge",
    )


def test_causes_add_up_and_bands_hold_the_loss() -> None:
    year = commuting()
    for cell in AGING_CELLS.values():
        causes = losses_by_cause(cell.law, year, 8.0)
        assert all(loss > 0.0 for loss in causes.values())
        drawn = drawn_losses(cell, year, draws=60)
        low, high = band(drawn)
        assert low < sum(causes.values()) < high
        assert np.array_equal(drawn, drawn_losses(cell, year, draws=60))


def test_without_spread_a_draw_is_the_law(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("iptm_life.life.SPREAD", dict.fromkeys(("rate", "energy", "exponent"), 0.0))
    year = commuting()
    for cell in AGING_CELLS.values():
        expected = sum(losses_by_cause(cell.law, year, 8.0).values())
        assert drawn_losses(cell, year, draws=2) == pytest.approx(expected, rel=1e-9)


def test_a_trip_between_and_beyond_the_starts_that_were_driven() -> None:
    """Between them a mixture; beyond them the pack warms by as much as from the nearest one."""
    driven = trip(3.0, compressor_j=1e6)
    between, beyond = driven.from_start(298.15), driven.from_start(323.15)
    assert between.end_k[0] == pytest.approx(301.15)
    assert between.compressor_j[0] == pytest.approx(0.5e6)
    assert beyond.end_k[0] == beyond.temperature_k[0, -1] == pytest.approx(326.15)
    assert beyond.compressor_j[0] == 1e6


def test_above_the_limit_the_pack_is_cooled_at_a_price() -> None:
    hot = Climate("hot", "made up", (39.0,) * 12, 0.0)
    year = year_of(COMMUTER, hot, NO_COOLING, [trip(5.0)] * 12, PARAMETERS)
    assert np.max(np.asarray(year.load.temperature_k)) <= 313.15 + 1e-9
    assert year.compressor_kwh > 0.0


@pytest.mark.parametrize("usage", USAGES, ids=[usage.name for usage in USAGES])
def test_no_usage_empties_the_pack(usage: Usage) -> None:
    for use in (usage, usage.managed()):
        trips = [trip(1.0, drawn=0.03)] * 12
        year = year_of(use, CLIMATES[0], DEFAULT, trips, PARAMETERS)
        assert np.min(np.asarray(year.load.charge)) > 0.05

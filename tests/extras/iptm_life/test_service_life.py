"""Years of use made of a trip of one's own, and notes about parameters that belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import iptm
from iptm.climate import CLIMATES
from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_life.life import losses_by_cause
from iptm_life.trip_map import nominal_energy_j, trip_map
from iptm_life.year import (
    COOLING_COP,
    UPPER_LIMIT_K,
    USAGES,
    _Day,
    heat_capacity_j_k,
    year_of,
)

TRIP = {"strategy": "production", "duration_s": 60.0}
START_C = (25.0, 35.0)


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    return iptm.simulate("us06", **TRIP)


def test_the_years_are_those_of_the_trips_driven_from_each_temperature(run: iptm.Run) -> None:
    found = iptm.life(run, cell="nca", climate="rome", usage="commuter", start_c=START_C)
    trips = [
        iptm.simulate(
            "us06", **TRIP, overrides={"environment.initial_cell_temperature_k": c + 273.15}
        ).trajectory
        for c in START_C
    ]
    by_hand = trip_map(trips, nominal_energy_j(run.parameters))
    year = year_of(USAGES[0], CLIMATES[1], "production", [by_hand] * 12, run.parameters)
    lost = losses_by_cause(AGING_CELLS["NCA"].law, year, 8.0)
    assert found.lost.sum() == pytest.approx(100.0 * sum(lost.values()))
    low, high = found.lost_band
    assert low < found.lost.sum() < high
    # Two trips on five days a week.
    assert found.distance_km == pytest.approx(
        365.25 * 10.0 / 7.0 * run.figures["distance"], rel=0.01
    )
    assert "Rome (trips in air of 35 degC), commuter" in found.sentence


def test_a_pack_that_a_trip_leaves_too_hot_is_cooled_to_the_limit(run: iptm.Run) -> None:
    """2 K above it: their heat, and a joule of the compressor takes 2.4 of it."""
    trip = trip_map([run.trajectory] * 2, nominal_energy_j(run.parameters))
    hot = replace(trip, start_k=np.array([300.0, 310.0]), end_k=np.full(2, UPPER_LIMIT_K + 2.0))
    day = _Day(run.parameters, USAGES[0], CLIMATES[1], 6, UPPER_LIMIT_K, 305.0, 0.8)
    day.drive(hot)
    heat_j = 2.0 * heat_capacity_j_k(run.parameters)
    assert day.compressor_j == pytest.approx(trip.compressor_j[0] + heat_j / COOLING_COP)
    assert day.kelvin == UPPER_LIMIT_K


def test_heat_and_years_cost_capacity(run: iptm.Run) -> None:
    hot, cold = (
        iptm.life(run, climate=climate, start_c=START_C).lost.sum()
        for climate in ("Phoenix", "Oslo")
    )
    longer = iptm.life(run, climate="Oslo", years=16.0, start_c=START_C).lost.sum()
    same = iptm.life(run, climate="Oslo", start_c=START_C, against=run)
    assert same.against is not None
    assert f"0.00 percentage points less than by the other run ({cold:.1f} %)" in same.sentence
    assert hot > cold
    assert longer > cold


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cell": "nc"}, "unknown cell 'nc'"),
        ({"climate": "Pheonix"}, "phoenix"),
        ({"usage": "bus"}, "bus"),
        ({"start_c": (30.0,)}, "two or more"),
        ({"usage": replace(USAGES[0], departures=((7.0, 2000),))}, "allowed: trips that end"),
    ],
)
def test_a_mistake_is_one_line(run: iptm.Run, arguments: dict, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(iptm.IptmError, match=message):
        iptm.life(run, **arguments)


def test_a_parameter_that_is_changed_alone_is_noted() -> None:
    def notes(**overrides: float) -> str:
        keys = {key.replace("__", "."): value for key, value in overrides.items()}
        return "\n".join(iptm.Trip.of("us06", overrides=keys).notes)

    assert not notes()
    assert not notes(body__mass_kg=1600.0)
    alone = notes(cell__nominal_capacity_ah=78.0)
    assert "cooling.convective_coefficient_w_k (0.4901 W/K) is that of paper_calibrated" in alone
    assert "cell.heat_capacity_j_k (45 J/K)" in alone
    together = {
        "cell__nominal_capacity_ah": 78.0,
        "cell__heat_capacity_j_k": 1100.0,
        "cell__nominal_resistance_ohm": 0.001,
        "cell__resistance_temperature_coefficient_1_k": -0.008,
        "cooling__convective_coefficient_w_k": 3.0,
    }
    assert not notes(**together)
    air = notes(environment__ambient_temperature_k=263.15)
    assert "affects the chiller; tyres, driveline and cabin are not modelled, nor drag" in air

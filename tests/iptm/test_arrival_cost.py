"""The cost of a temperature on arrival, as a setting of a trip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import iptm
from iptm.trip_files import trip_from, trip_text
from iptm_core.errors import IptmError

PARKED_LONG, CHARGE = "-20:0.0, 25:0.4, 45:1.6", "-20:60.0, 20:6.0, 30:5.0, 45:5.0"
"""Warm cells age while they are parked; at a fast charger a cold pack costs minutes."""


def driven(air_c: float, **settings: Any) -> iptm.Run:
    kelvin = air_c + 273.15
    parked = {
        "environment.ambient_temperature_k": kelvin,
        "environment.initial_cell_temperature_k": kelvin,
        "limits.max_heater_power_w": 5000.0,
    }
    return iptm.simulate(
        "us06", duration_s=300.0, overrides=parked, strategy="prices", aging_law="nca", **settings
    )


@pytest.mark.parametrize(
    ("air_c", "parked_sign", "charge_sign"), [(35.0, 1.0, 0.0), (-5.0, 0.0, -1.0)]
)
def test_a_fast_charge_ahead_turns_the_decision_about_the_pack(
    air_c: float, parked_sign: float, charge_sign: float
) -> None:
    """Hot, before a long stay it is cooled, before a charger not; cold, before a charger it is heated."""
    for cost, sign in ((PARKED_LONG, parked_sign), (CHARGE, charge_sign)):
        thermal_w = driven(air_c, arrival_cost_eur=cost).trajectory.compressor_power_w
        mean_w = float(np.mean(thermal_w))
        assert np.sign(mean_w) * (abs(mean_w) > 50.0) == sign, (cost, mean_w)


def test_without_a_cost_a_trip_is_as_before() -> None:
    plain, empty = driven(35.0), driven(35.0, arrival_cost_eur="")
    assert np.array_equal(
        plain.trajectory.cell_n_temperature_k, empty.trajectory.cell_n_temperature_k
    )
    assert "arrival" not in plain.name


def test_the_cost_is_a_setting_of_a_trip_file(tmp_path: Any) -> None:
    trip = trip_from({"controller": {"arrival_cost_eur": PARKED_LONG}}, "file", "mine", tmp_path)
    assert trip.options.arrival is not None
    assert trip.options.arrival.eur == (0.0, 0.4, 1.6)
    assert PARKED_LONG in trip_text(trip)
    beyond = trip.changed(value_beyond_trip=True)
    assert beyond.options.trip_duration_s == trip.route.duration_s


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("20", "arrival_cost_eur is '20'; allowed: <degC>:<EUR>"),
        ("20:0.1", "two or more"),
        ("20:0.1, 20:0.2", "increasing temperatures"),
        ("20:0.1, 25:nan", "two or more known values"),
        ("warm:1, 25:2", "arrival_cost_eur is 'warm:1, 25:2'"),
    ],
)
def test_other_texts_are_refused(text: str, message: str) -> None:
    with pytest.raises(IptmError, match=message) as refused:
        iptm.Trip.of("us06", arrival_cost_eur=text)
    assert "\n" not in str(refused.value)

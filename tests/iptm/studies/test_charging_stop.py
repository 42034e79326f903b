"""Trips to a fast charger: what is driven, what the page shows, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from iptm.studies.life import cli
from iptm.studies.life.charging_page import charging_page
from iptm.studies.life.charging_stop import (
    FIRST_CAR,
    HEATER_W,
    SHORT,
    Preparation,
    arrival,
    charging_damage,
)
from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.charging_stop import ChargingStopSettings, fast_charge
from iptm_core.parameters import load_parameters

STOP = ChargingStopSettings()
PAPER = load_parameters().values


def arrived(preparation: Preparation, arrival_c: float, battery_kwh: float) -> dict[str, Any]:
    kelvin = np.array([arrival_c + 273.15])
    charges = (
        fast_charge(kelvin, replace(STOP, charging_heater_kw=kilowatt), PAPER)
        for kilowatt in (0.0, 5.0)
    )
    return {"car": FIRST_CAR, "air_c": 5.0, "preparation": preparation, "arrival_c": arrival_c} | {
        "battery_kwh": battery_kwh,
        "minute_kwh": 0.5,
        **dict(zip(("charge", "heated"), charges, strict=True)),
    }


@pytest.fixture(scope="module")
def trips() -> dict[Preparation, dict[str, Any]]:
    settings = {**SHORT, "duration_s": 120.0}
    return {each: arrival(FIRST_CAR, 5.0, each, **settings) for each in Preparation}


def test_a_trip_without_preparation_arrives_cold(trips: dict[Preparation, dict[str, Any]]) -> None:
    assert trips[Preparation.NONE]["arrival_c"] == pytest.approx(5.0, abs=0.2)


def test_both_preparations_heat_all_of_a_short_trip(
    trips: dict[Preparation, dict[str, Any]],
) -> None:
    """5 kW after a ramp of 25 s: 0.15 kWh, of which 350 kJ/K get warmer by 1.5 K."""
    base = trips[Preparation.NONE]
    most_kwh = HEATER_W * (120.0 - 12.5) / 3.6e6
    for preparation in (Preparation.LAST_MINUTES, Preparation.OPTIMISED):
        trip = trips[preparation]
        spent_kwh = trip["battery_kwh"] - base["battery_kwh"]
        assert 0.9 * most_kwh < spent_kwh < 1.3 * most_kwh
        warmer_k = trip["arrival_c"] - base["arrival_c"]
        assert warmer_k == pytest.approx(most_kwh * 3.6e6 / 350e3, rel=0.1)
        assert trip["charge"].minutes[0] < base["charge"].minutes[0] - 5.0
        assert trip["heated"].minutes[0] < trip["charge"].minutes[0]


def test_the_damage_of_a_charge_is_the_rate_times_its_duration() -> None:
    """A law without dependence on temperature and current: damage per charge moved."""
    charge = fast_charge(np.array([290.0]), STOP, PAPER)
    for cell in AGING_CELLS.values():
        doubled = replace(charge, step_s=2.0 * charge.step_s, c_rate_1_h=0.5 * charge.c_rate_1_h)
        assert charging_damage(cell, charge) >= 0.0
        assert charging_damage(cell, replace(charge, step_s=0.0 * charge.step_s + 1e-9)) < 1e-6
        # The same charge at half of the current never ages more than half as fast over twice the time.
        assert charging_damage(cell, doubled) <= charging_damage(cell, charge) * (1.0 + 1e-9)


def test_the_page_shows_differences_to_no_preparation() -> None:
    trips = [
        arrived(Preparation.NONE, 5.0, 3.0),
        arrived(Preparation.LAST_MINUTES, 25.0, 4.7),
        arrived(Preparation.OPTIMISED, 15.0, 4.1),
    ]
    evening = {"place": "Rome, July", "cooling": "chiller", "arrival_c": 26.0}
    evening |= {"thermal_kwh": 0.25, "removed_kwh": 0.5}
    page = charging_page("scripts/life --charging-stop", trips, trips[1:2], [evening])
    saved = float(trips[0]["charge"].minutes[0] - trips[2]["charge"].minutes[0])
    assert (
        f"| 5 | optimised | 15.0 | 1.10 | {trips[2]['charge'].minutes[0]:.1f} | {saved:.1f} |"
        in page
    )
    assert "| 0.5 | 25.0 | 1.70 |" in page
    assert "| Rome, July | chiller | 26.0 | 0.250 | 0.500 | 2.0 |" in page
    assert "Lithium plating is in none of the laws" in page


def test_the_command_writes_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = arrived(Preparation.NONE, 5.0, 3.0)
    monkeypatch.setattr(cli, "arrivals", lambda *_, **__: [made])
    monkeypatch.setattr(cli, "evenings", lambda **_: [])
    assert cli.main(["--charging-stop", "--short", "--output", str(tmp_path)]) == 0
    page = tmp_path / "charging-stop.md"
    assert capsys.readouterr().out.strip().endswith(str(page))
    assert "scripts/life --short --charging-stop" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("option", ["--stored", "--dry-run"])
def test_what_is_not_stored_cannot_be_found(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["--charging-stop", option]) == 2
    assert "allowed: without" in capsys.readouterr().err

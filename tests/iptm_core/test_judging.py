"""One use for all laws: what is repeated, losses by hand, and what cannot be judged."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_core.made_runs import PARAMETERS, make_run

from iptm_core.aging_laws.cells import AGING_CELLS, NCA
from iptm_core.aging_laws.judging import (
    CELL_JUDGES,
    CHARGED_K,
    CHARGING_1_H,
    DAYS,
    Exposure,
    loss_by_law,
    loss_by_paper,
)
from iptm_core.aging_laws.law import Load, Mechanism, paper_law
from iptm_core.errors import StateError

TIME_S = np.arange(0.0, 1801.0)
TRIP = Exposure(TIME_S, 0.9 - 0.1 * TIME_S / 1800.0, np.full(TIME_S.size, 303.15))


def parked(kelvin: float) -> Exposure:
    return Exposure(TIME_S, np.full(TIME_S.size, 0.9), np.full(TIME_S.size, kelvin))


def test_a_trip_is_charged_back_at_the_stated_rate() -> None:
    use = TRIP.repeated(2)
    ends_s = TIME_S[-1] + 3600.0 * 0.1 / CHARGING_1_H
    one = use.time_s <= ends_s
    assert use.time_s[one][-1] == pytest.approx(ends_s)
    assert use.charge[one][-1] == pytest.approx(0.9)
    assert use.temperature_k[one][-1] == CHARGED_K
    assert use.time_s[-1] == pytest.approx(2.0 * ends_s + 1.0)
    charging = one & (use.time_s >= TIME_S[-1])
    rates_1_h = 3600.0 * np.diff(use.charge[charging]) / np.diff(use.time_s[charging])
    assert rates_1_h == pytest.approx(np.full(rates_1_h.size, CHARGING_1_H))


def test_a_trip_that_takes_nothing_is_not_charged() -> None:
    assert parked(303.15).repeated(3).time_s[-1] == 3 * 1800.0 + 2.0


@pytest.mark.parametrize("judge", CELL_JUDGES, ids=lambda judge: judge.name)
def test_a_parked_car_loses_what_the_calendar_law_gives(judge: object) -> None:
    """At 25 and 35 degC, from the rate alone: k t^p; all cells lose more in the heat."""
    law = AGING_CELLS[judge.name].law  # type: ignore[attr-defined]
    losses = []
    for kelvin in (298.15, 308.15):
        load = Load(kelvin, 0.0, 0.9)
        by_hand = sum(
            float(part.damage_rate_1_s(load) * DAYS * 86400.0) ** part.exponent
            for part in law.mechanisms
            if part.mechanism is Mechanism.CALENDAR
        )
        losses.append(judge.loss(parked(kelvin)))  # type: ignore[attr-defined]
        assert losses[-1] == pytest.approx(by_hand)
    assert losses[0] < losses[1]


def test_the_paper_counts_the_trip_of_both_cells_and_no_rest() -> None:
    assert loss_by_paper(PARAMETERS, parked(308.15)) == pytest.approx(0.0, abs=1e-15)
    law = paper_law(PARAMETERS).mechanisms[0]
    z, initial = law.exponent, PARAMETERS.aging.initial_capacity_loss
    lost = [
        (initial ** (1.0 / z) + 1800.0 * float(law.damage_rate_1_s(Load(k, 0.2)))) ** z - initial
        for k in (302.15, 304.15)
    ]
    apart = Exposure(TIME_S, TRIP.charge, TRIP.temperature_k, np.full(TIME_S.size, 2.0))
    assert loss_by_paper(PARAMETERS, apart) == pytest.approx(np.mean(lost), rel=1e-6)


def test_current_of_one_run_at_the_temperature_of_another() -> None:
    cold = Exposure(TIME_S[:901] + 50.0, TRIP.charge[:901], np.linspace(290.15, 300.15, 901))
    both = TRIP.at(cold)
    assert both.charge is not cold.charge
    assert both.temperature_k[[0, 450, 1800]] == pytest.approx([290.15, 295.15, 300.15])
    assert loss_by_law(NCA.law, both) < loss_by_law(NCA.law, TRIP)


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (
            make_run(state_of_charge=np.full(4, np.nan)),
            "charge is nan in row 0.* unknown in 4 of 4",
        ),
        (make_run(cell_n_temperature_k=np.full(4, np.nan)), "temperature_k is nan in row 0"),
        (
            make_run(time_s=np.array([0.0, 1.0, 300.0, 301.0])),
            "299 s without a row after 1 s.* 60 s",
        ),
        (make_run(1), "shape .1,.; allowed"),
    ],
)
def test_a_run_without_current_or_with_a_gap_is_refused(run: object, message: str) -> None:
    with pytest.raises(StateError, match=message):
        Exposure.of(run)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ((TIME_S, TRIP.charge[:-1], TRIP.temperature_k), r"charge has shape \(1800,\)"),
        ((TIME_S[::-1], TRIP.charge, TRIP.temperature_k), "step of -1 s"),
        (
            (TIME_S, np.where(TIME_S == 7, np.inf, 0.5), TRIP.temperature_k),
            "charge is inf in row 7",
        ),
    ],
)
def test_columns_that_are_no_exposure_are_refused(columns: tuple, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(StateError, match=message):
        Exposure(*columns)

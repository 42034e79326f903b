"""What one run saved against another one: the number to quote, worked out by hand, or why there is none."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.iptm_core.made_runs import make_run

from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.metrics.following import Following
from iptm_core.metrics.repeated import Repeated
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics
from iptm_core.metrics.saved_share import Basis, Judgement, saved_text
from iptm_core.metrics.saving import (
    LARGEST_CORRECTION_POINTS,
    SHORTEST_TRIP_S,
    SHORTEST_WHOLE_S,
    Saving,
    cool_down,
    judge_saving,
)
from iptm_core.parameters import load_parameters

PARAMETERS = load_parameters().values
OTHER = replace(
    compute_metrics(make_run(), PARAMETERS),
    duration_s=SHORTEST_WHOLE_S,
    distance_m=5000.0,
    battery_energy_j=4e6,
    cell_1_degradation=4e-6,
    cell_n_degradation=6e-6,
    final_cell_losses=(1e-3, 1e-3),
    final_charge=0.5,
    following=Following(),
    cell_losses={},
)


def judged(other: RunMetrics = OTHER, **own: Any) -> Saving:
    return judge_saving(replace(other, **own), other, PARAMETERS)


def test_runs_with_the_same_end_are_compared_as_driven() -> None:
    found = judged(battery_energy_j=3e6, cell_1_degradation=2e-6)
    assert found.aging.judgement is found.energy.judgement is Judgement.JUDGED
    assert found.aging.percent == found.aging.as_driven_percent == pytest.approx(20.0)
    assert found.energy.percent == pytest.approx(25.0)
    assert found.lines[:1] == [("energy", "25.0 % saved (as driven 25.0 % saved)")]
    assert "ageing, paper's law: 20.0 % saved (as driven 20.0 % saved)" in found.headline
    lost = judged(cell_n_degradation=7e-6)
    assert lost.aging.text == "10.0 % lost"


def test_the_warmer_pack_pays_for_its_cooling() -> None:
    """The headline is the corrected number, which a second computation of the parts confirms."""
    warmer_k = OTHER.final_temperature_k + 0.2
    found = judged(final_temperature_k=warmer_k, cell_1_degradation=2e-6)
    own = replace(OTHER, final_temperature_k=warmer_k)
    price = cool_down(own, OTHER.final_temperature_k, PARAMETERS)
    assert price is not None
    assert price[0] > 0.0
    assert found.aging.percent == pytest.approx(100.0 * (1.0 - (8e-6 + price[1]) / 1e-5))
    assert found.energy.percent == pytest.approx(-100.0 * price[0] / 4e6)
    assert found.aging.percent < found.aging.as_driven_percent


def test_cold_air_helps_to_cool_the_pack_down() -> None:
    end = replace(OTHER, final_temperature_k=313.15)
    overrides = {"environment.ambient_temperature_k": 273.15}
    prices = [
        cool_down(end, 303.15, load_parameters(overrides=overrides | air).values)
        for air in ({}, {"cooling.air_exchange_w_k": 20.0})
    ]
    assert None not in prices
    assert prices[1] < prices[0]  # type: ignore[operator]


@pytest.mark.parametrize(
    ("own", "judgement"),
    [
        ({"duration_s": SHORTEST_TRIP_S - 1.0}, Judgement.TOO_SHORT),
        ({"distance_m": 4000.0}, Judgement.OTHER_TRIP),
        ({"duration_s": 2.0 * SHORTEST_WHOLE_S}, Judgement.OTHER_TRIP),
        ({"final_temperature_k": math.nan}, Judgement.UNKNOWN),
    ],
)
def test_what_cannot_be_judged_has_a_word_and_no_number(
    own: dict[str, float], judgement: Judgement
) -> None:
    found = judged(**own)
    for share in (found.aging, found.energy):
        assert share.judgement is judgement
        assert math.isnan(share.percent)
        assert share.text == str(judgement)
    assert math.isnan(found.values["aging_saved"])
    assert math.isfinite(found.values["aging_saved_as_driven"])


def test_a_trip_whose_ends_decide_is_repeated_or_has_a_band() -> None:
    """Five kelvin left in the pack change a trip of 4 MJ by more than a few points; the ageing by less."""
    warm = replace(OTHER, final_temperature_k=OTHER.final_temperature_k + 5.0)
    found = judge_saving(warm, OTHER, PARAMETERS)
    correction = found.energy.as_driven_percent - found.energy.equal_ends_percent
    assert correction > LARGEST_CORRECTION_POINTS
    assert found.energy.basis is Basis.BETWEEN
    assert found.energy.percent == pytest.approx(-0.5 * correction)
    assert found.values["energy_saved_uncertainty"] == pytest.approx(0.5 * correction)
    assert f"±{0.5 * correction:.1f} points, between equal ends and as driven" in found.headline
    assert found.aging.basis is Basis.EQUAL_ENDS
    own, other = (Repeated(joule, 1e-5, {}, 0.006, 0.0, 4) for joule in (780.0, 800.0))
    found = judge_saving(warm, OTHER, PARAMETERS, repeat=lambda: (own, other))
    assert found.energy.percent == pytest.approx(2.5)
    assert f"; equal ends {correction:.1f} % lost; as driven " in found.headline
    assert found.energy.uncertainty_points == pytest.approx(97.5 * 0.006 * math.sqrt(2.0))
    assert found.aging.percent == found.aging.equal_ends_percent, "equal ends hardly change it"


def test_late_ticks_are_not_judged() -> None:
    assert judge_saving(OTHER, OTHER, PARAMETERS, late=True).energy.judgement is Judgement.LATE


@pytest.mark.parametrize("charges", [[0.02, 0.01, 0.0, -0.01], [0.99, 1.0, 1.0, 1.1]])
def test_an_empty_or_overfull_pack_breaks_a_hard_limit_and_saves_nothing(
    charges: list[float],
) -> None:
    empty = compute_metrics(make_run(state_of_charge=np.array(charges)), PARAMETERS)
    (check,) = (check for check in empty.broken_limits if check.hard)
    assert check.text.startswith("charge outside of 0 to 100 % (hard limit): 1 tick, first at 3 s")
    assert judged(constraints=empty.constraints).aging.judgement is Judgement.LIMIT_BROKEN
    other = replace(OTHER, constraints=empty.constraints)
    assert judge_saving(OTHER, other, PARAMETERS).energy.judgement is Judgement.LIMIT_BROKEN


def test_savings_in_words() -> None:
    assert saved_text(49.84) == "49.8 % saved"
    assert saved_text(-150.2) == "150 % lost"
    assert saved_text(math.nan) == "–"


def test_ageing_is_stated_by_the_median_and_the_range_of_the_measured_cells() -> None:
    other = replace(OTHER, cell_losses={"a": 1e-2, "b": 2e-2, "c": 4e-2})
    found = judged(other, cell_losses={"a": 0.9e-2, "b": 1.6e-2, "c": 4.4e-2})
    assert found.cells.percents == pytest.approx({"a": 10.0, "b": 20.0, "c": -10.0})
    assert found.cells.text == "10.0 % saved (-10.0 to 20.0 %)"
    assert found.values["aging_saved_by_cells"] == pytest.approx(10.0)
    short = judged(other, cell_losses=other.cell_losses, duration_s=50.0)
    assert short.cells.text == "too short to judge"
    assert math.isnan(short.values["aging_saved_by_cells"])
    assert math.isnan(judged().cells.median), "current or temperature is not known"


def test_a_statement_has_the_distance_and_the_preview() -> None:
    run = make_run(
        6,
        speed_m_s=np.full(6, 10.0),
        leader_position_m=np.array([30.0, 15.0, 14.0, 30.0, 16.0, 30.0]),
        leader_speed_m_s=np.full(6, 10.0),
        position_m=np.zeros(6),
    )
    kept = compute_metrics(run, PARAMETERS).following
    least_m = 30.0 - gap_margins_m(run, PARAMETERS)[0]
    assert least_m > 16.0
    assert (kept.below_s, kept.longest_below_s) == (3.0, 1.0)
    assert kept.smallest_margin_m == pytest.approx(14.0 - least_m)
    assert (kept.mean_headway_s, kept.headway_s) == pytest.approx((2.25, 2.3))
    found = judge_saving(
        replace(OTHER, following=kept), OTHER, PARAMETERS, preview="60 s, perfect"
    ).headline
    text = "headway 2.25 s mean, 2.30 s median, below s_min for 3 s, 1 s in a row, by up to"
    assert text in found
    assert "preview: 60 s, perfect" in found
    assert "distance kept" not in judged().headline, "no leader was measured"


def test_no_pack_is_cooled_below_its_lower_limit() -> None:
    """At -10 degC of air warmth is no debt; between 20 and 30 degC the pack is cooled to T_b,min."""
    cold = replace(OTHER, final_temperature_k=268.15)
    found = judged(cold, final_temperature_k=266.15, battery_energy_j=3e6)
    assert found.energy.percent == found.energy.as_driven_percent == pytest.approx(25.0)
    assert found.ends is not None
    least_k = PARAMETERS.limits.min_temperature_k
    assert {end.temperature_k for end in found.ends} == {least_k}
    warm = replace(OTHER, final_temperature_k=least_k + 0.1)
    price = cool_down(warm, least_k, PARAMETERS)
    assert price is not None
    found = judged(warm, final_temperature_k=least_k - 5.0)
    assert found.energy.equal_ends_percent == pytest.approx(100.0 * (1.0 - 4e6 / (4e6 + price[0])))

"""Ten commutes: the saving of a few repetitions is the saving of many that follow each other.

Twenty, of which ten lead in; sixty where a thermostat cycles, and up to 150 where the pack still drifts. With
``-s`` the savings are printed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import iptm
from iptm.repetition import one_after_the_other, repeat
from iptm_core.metrics.repeated import NOTED_DRIFT_K, Repeated, Repetition, over_cycles
from iptm_core.metrics.saved_share import saved_percent

PAPER, ID4, BOLT = "paper_calibrated", "volkswagen_id4", "chevrolet_bolt"
COMMUTES = (
    (ID4, "udds", 300.0, 25.0, "flat"),
    (ID4, "sc03", 590.0, 38.0, "small"),
    (ID4, "wltc_class3b", 900.0, -5.0, "flat"),
    (BOLT, "us06", 600.0, 35.0, "flat"),
    (BOLT, "udds", 1360.0, 0.0, "large"),
    (BOLT, "nycc", 590.0, 40.0, "flat"),
    (PAPER, "hwfet", 760.0, 35.0, "flat"),
    (PAPER, "wltc_class3b", 1790.0, 35.0, "small"),
    (PAPER, "us06", 300.0, 35.0, "large"),
    (PAPER, "udds", 1000.0, 10.0, "flat"),
)
DRIVEN, LED_IN, CYCLING, SLOWEST = 20, 10, 60, 150
CYCLE_K = 0.3
"""Difference of drifts above which a thermostat cycles."""
TOLERANCE_POINTS = 0.5


def one_by_one(run: iptm.Run) -> Repeated:
    tiles: list[Repetition] = []
    for tile in one_after_the_other(run):
        tiles.append(tile)
        if len(tiles) < DRIVEN:
            continue
        drifts_k = np.array([each.drift_k for each in tiles[LED_IN:]])
        cycles = np.ptp(drifts_k) > CYCLE_K and drifts_k.min() < 0.0 < drifts_k.max()
        drifts = abs(drifts_k[-LED_IN:].mean()) > NOTED_DRIFT_K
        if len(tiles) >= (CYCLING if cycles else SLOWEST if drifts else DRIVEN):
            break
    return over_cycles(tiles[LED_IN:], len(tiles))


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "cycle", "duration_s", "climate", "slope"), COMMUTES)
def test_a_commute_saves_what_its_repetitions_save(
    vehicle: str, cycle: str, duration_s: float, climate: float, slope: str
) -> None:
    call = {"vehicle": vehicle, "duration_s": duration_s, "climate": climate, "slope": slope}
    runs = [
        iptm.simulate(cycle, **call, strategy=each) for each in ("aging_cost_to_go", "production")
    ]
    found, driven = ([make(run) for run in runs] for make in (repeat, one_by_one))
    for name in ("energy_per_distance_j_m", "capacity_loss"):
        few, many = (
            saved_percent(*(getattr(each, name) for each in both)) for both in (found, driven)
        )
        print(f"{vehicle} {cycle} {name}: {few:.2f} % saved, one by one {many:.2f} %")
        assert few == pytest.approx(many, abs=TOLERANCE_POINTS)
    print([each and each.repetitions for each in (*found, *driven)])


def test_a_run_without_a_trip_is_refused() -> None:
    run = iptm.simulate("us06", duration_s=60.0, strategy="production")
    with pytest.raises(iptm.IptmError, match="cannot be repeated: its trip is not known"):
        next(one_after_the_other(replace(run, trip=None)))

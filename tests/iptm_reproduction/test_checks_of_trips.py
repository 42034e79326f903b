"""Checks on whole trips and the payback of cooling, against trips and laws written out by hand."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.iptm_reproduction.made_store import made_claim

from iptm_core.parameters import ModelParameters, load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_reproduction.aging import cooling_payback, printed_cooling
from iptm_reproduction.names import PROPOSED, REFERENCE
from iptm_reproduction.printed import Verdict
from iptm_reproduction.results import Results
from iptm_reproduction.trips import (
    PowerRegions,
    blocks_of,
    busiest_window,
    share_while_braking,
    time_to_fall_s,
)

REPRODUCED, SIGN_ONLY, NOT, _ = Verdict
PARAMETERS = load_parameters().values
KELVIN = 299.15


def trip(**columns: Any) -> Trajectory:
    """A trip whose columns are constant but for those given; the latter set its length."""
    rows = max((np.size(values) for values in columns.values()), default=11)
    level = dict.fromkeys(TRAJECTORY_COLUMNS, 0.0) | {
        "cell_1_temperature_k": 303.15,
        "cell_n_temperature_k": 303.15,
        "coolant_inlet_temperature_k": 298.15,
        "coolant_outlet_temperature_k": 300.15,
        "cell_1_capacity_loss": 1e-3,
        "cell_n_capacity_loss": 1e-3,
        "leader_position_m": 50.0,
        "smallest_gap_m": 50.0,
    }
    arrays = {name: np.full(rows, value) for name, value in level.items()}
    arrays["time_s"] = np.arange(float(rows))
    return Trajectory.from_arrays({**arrays, **columns})


def results(**trips: Trajectory) -> Results:
    """The trips of strategies, without any figure."""
    runs: Any = {
        f"strategies/{name}": SimpleNamespace(trajectory=trajectory)
        for name, trajectory in trips.items()
    }
    return Results({address: {"duration": 1.0} for address in runs}, load=runs.__getitem__)


def cooled(
    trajectory: Trajectory, cop: float | None, parameters: ModelParameters = PARAMETERS
) -> Any:
    """A run with a coefficient of performance."""
    metrics = SimpleNamespace(mean_cop=cop)
    return SimpleNamespace(trajectory=trajectory, parameters=parameters, metrics=metrics)


def drawing(power_kw: Any) -> Trajectory:
    """A trip with the given battery power in kW; row 0 ends no interval."""
    return trip(battery_power_w=np.concatenate([[0.0], 1e3 * np.asarray(power_kw, dtype=float)]))


def test_power_regions_hold_their_share_of_time() -> None:
    reference = drawing(np.arange(1.0, 101.0))
    regions = PowerRegions.of_reference(reference)
    assert (regions.low_kw, regions.high_kw) == pytest.approx((50.5, 90.1))
    assert regions.shares(reference) == pytest.approx((0.5, 0.4, 0.1))
    assert regions.shares(drawing(np.full(100, 2.0))) == pytest.approx((1.0, 0.0, 0.0))


def powers(compressor_w: Any, traction_w: Any, auxiliary_w: float = 100.0) -> Trajectory:
    return trip(
        traction_power_w=np.asarray(traction_w),
        compressor_power_w=np.broadcast_to(compressor_w, np.shape(traction_w)).astype(float),
        auxiliary_power_w=np.full(np.size(traction_w), auxiliary_w),
    )


def cooling(at_low_w: float, at_high_w: float, braking_w: float) -> Trajectory:
    """A trip with compressor powers at low and at high traction power, and while braking."""
    traction = np.repeat([0.0, -1e3, 1e3, 2e4, 3e4], [1, 20, 60, 15, 5])
    high = [braking_w, at_high_w]
    return powers(np.select([traction < 0.0, traction >= 2e4], high, default=at_low_w), traction)


def warm(cell_1_c: Any, cell_n_c: Any, traction_w: Any = 0.0) -> Trajectory:
    return trip(
        cell_1_temperature_k=np.asarray(cell_1_c, dtype=float) + 273.15,
        cell_n_temperature_k=np.asarray(cell_n_c, dtype=float) + 273.15,
        traction_power_w=np.broadcast_to(traction_w, np.shape(cell_1_c)).astype(float),
    )


def settling(end_c: float) -> Trajectory:
    values = np.repeat([35.0, end_c], 10)
    return warm(values, values)


def demanding(places: list[float], temperatures_c: list[float]) -> Trajectory:
    """A trip with its demand after 20 s, and temperatures at some places."""
    values = np.interp(np.arange(40.0), places, temperatures_c)
    return warm(values, values, np.repeat([0.0, 1e4, 0.0], [21, 10, 9]))


def heating(after_c: float) -> Trajectory:
    return demanding([0.0, 20.0, 30.0, 39.0], [35.0, 30.0, after_c, 28.0])


RISING = drawing(np.arange(1.0, 101.0))
QUICK, SLOW = (25.0 + 10.0 * np.exp(-np.arange(100.0) / time_s) for time_s in (5.0, 20.0))
ALTERNATING = np.tile([-6000.0, 6000.0], 6)
REGIONS = {"others": REFERENCE, "reference": REFERENCE}
PEAKS = {"others": REFERENCE, "percentile": 99.0}
SETTLES = {"printed_c": 30.0, "tolerance_k": 2.0, "last_share": 0.5}
FALLS = {"share": 0.63}
HEATS = {"runs": PROPOSED, "length_s": 10.0, "least_rise_k": 1.0}
COOLED = {"runs": PROPOSED, "length_s": 10.0, "least_drop_k": 2.0}


@pytest.mark.parametrize(
    ("kind", "arguments", "proposed", "expected"),
    [
        ("power_regions", REGIONS, drawing(np.full(100, 2.0)), REPRODUCED),
        # Less time at high power, but none at low power.
        ("power_regions", REGIONS, drawing(np.full(100, 60.0)), SIGN_ONLY),
        ("power_regions", REGIONS, drawing(np.full(100, 95.0)), NOT),
        ("lower_peaks", PEAKS, drawing([1.0, 50.0]), REPRODUCED),
        ("lower_peaks", PEAKS, drawing([100.0, 100.0]), NOT),
        ("traction_dominates", {"factor": 5.0}, powers(900.0, ALTERNATING), REPRODUCED),
        ("traction_dominates", {"factor": 5.0}, powers(3000.0, ALTERNATING), SIGN_ONLY),
        ("traction_dominates", {"factor": 5.0}, powers(9000.0, ALTERNATING), NOT),
        ("cools_off_peak", {}, cooling(500.0, 0.0, 600.0), REPRODUCED),
        ("cools_off_peak", {}, cooling(500.0, 100.0, 50.0), SIGN_ONLY),
        ("cools_off_peak", {}, cooling(0.0, 500.0, 0.0), NOT),
        ("settles_near", SETTLES, settling(31.0), REPRODUCED),
        ("settles_near", SETTLES, settling(33.5), SIGN_ONLY),
        ("settles_near", SETTLES, settling(36.0), NOT),
        ("settles_near", SETTLES, settling(27.0), NOT),
        ("last_cell_falls_slower", FALLS, warm(QUICK, SLOW), REPRODUCED),
        ("last_cell_falls_slower", FALLS, warm(SLOW, QUICK), NOT),
        ("heats_in_demand", HEATS, heating(33.0), REPRODUCED),
        ("heats_in_demand", HEATS, heating(30.2), SIGN_ONLY),
        ("heats_in_demand", HEATS, heating(29.0), NOT),
        ("cooled_before_demand", COOLED, demanding([0.0, 20.0], [35.0, 30.0]), REPRODUCED),
        ("cooled_before_demand", COOLED, demanding([0.0, 20.0], [35.0, 34.0]), SIGN_ONLY),
        ("cooled_before_demand", COOLED, demanding([0.0, 20.0], [35.0, 35.0]), NOT),
        ("aging_falls", {}, RISING, REPRODUCED),
        ("aging_exponential", {"temperature_c": 30.0, "least_excess": 0.5}, RISING, REPRODUCED),
        # Doubling the current does not multiply the loss by 20.
        ("aging_exponential", {"temperature_c": 30.0, "least_excess": 9.0}, RISING, SIGN_ONLY),
    ],
)
def test_checks(
    kind: str, arguments: dict[str, Any], proposed: Trajectory, expected: Verdict
) -> None:
    given = {} if "runs" in arguments or kind.startswith("aging") else {"run": PROPOSED}
    claim = made_claim(kind, **given, **arguments)
    assert "eproduced" in claim.rule
    finding = claim.check(results(aging=proposed, reference=RISING))
    assert finding.verdict is expected
    assert finding.found


def test_findings_give_times() -> None:
    falls = made_claim("last_cell_falls_slower", run=PROPOSED, share=0.63)
    finding = falls.check(results(aging=warm(QUICK, SLOW)))
    assert finding.found == "cell 1 5 s, cell N 20 s"
    heats = made_claim("heats_in_demand", **HEATS)
    assert "from 20 s on" in heats.check(results(aging=heating(33.0))).found


def test_busiest_window_is_found_wherever_it_lies() -> None:
    power = np.zeros(100)
    power[41:51] = 5.0
    power[80] = 7.0
    assert busiest_window(trip(traction_power_w=power), 10.0) == (40, 50)
    assert busiest_window(trip(traction_power_w=power), 1000.0) == (0, 99)


def test_helpers_of_quantities() -> None:
    times = np.arange(5.0)
    assert time_to_fall_s(times, np.array([10.0, 8.0, 6.0, 2.0, 0.0]), 0.5) == 3.0
    assert blocks_of(np.arange(12.0), 4).mean(axis=1).tolist() == [1.0, 4.0, 7.0, 10.0]
    assert blocks_of(np.arange(11.0), 4).tolist()[-1] == [8.0, 9.0]


def test_cooling_pays_after_the_time_worked_out_by_hand() -> None:
    """At constant power, without resistance and entropy, the derivatives have a closed form."""
    parameters = load_parameters(
        overrides={
            "cell.nominal_resistance_ohm": 1e-5,
            "cell.resistance_temperature_coefficient_1_k": 0.0,
            "cell.entropic_coefficient_v_k": 0.0,
        }
    ).values
    power_w, cop = 10_000.0, 2.0
    trajectory = trip(battery_power_w=np.full(20, power_w))
    payback = cooling_payback(cooled(trajectory, cop, parameters), (50.0,))
    assert payback is not None
    aging, cell, pack = parameters.aging, parameters.cell, parameters.pack
    current = power_w / (pack.open_circuit_voltage_v * pack.parallel)
    scale = aging.throughput_exponent * aging.gas_constant_j_mol_k * 303.15
    rate = current / cell.nominal_capacity_ah
    per_ampere = 1.0 / current + aging.compensation_factor_j_mol / (
        cell.nominal_capacity_ah * scale
    )
    per_kelvin = (aging.activation_energy_j_mol - aging.compensation_factor_j_mol * rate) / (
        scale * 303.15
    )
    per_watt = per_ampere / (pack.open_circuit_voltage_v * pack.parallel)
    kelvin_per_joule = cop / (16 * 228 * cell.heat_capacity_j_k)
    assert payback.times_s[power_w] == pytest.approx(
        per_watt / (per_kelvin * kelvin_per_joule), rel=1e-3
    )
    assert payback.cooling_k_kj == pytest.approx(1e3 * kelvin_per_joule)
    assert payback.aging_per_kelvin == pytest.approx(per_kelvin, rel=1e-3)


def test_cooling_that_never_ran_pays_never() -> None:
    assert cooling_payback(cooled(trip(), None), (50.0,)) is None
    assert share_while_braking(trip()) is None
    power = np.array([0.0, 100.0, 300.0])
    trajectory = trip(compressor_power_w=power, traction_power_w=np.array([0.0, 5.0, -5.0]))
    assert share_while_braking(trajectory) == pytest.approx(0.75)


def test_figures_follow_from_the_printed_tables_by_hand() -> None:
    found = printed_cooling(load_parameters("paper_identified").values, KELVIN)
    gas = 0.824 * 8.314462618
    power_w = 187082.68e3 / 1e4
    c_rate = mean_c_rate_1_h()
    per_kelvin = (15162.0 - 1516.0 * c_rate) / (gas * KELVIN**2)
    differ_k = math.log(1.3718 / 1.2789) / per_kelvin
    assert found.cells_differ_k == pytest.approx(differ_k, rel=1e-3)
    assert found.heat_w == pytest.approx(0.144 * 3330.0 * differ_k, rel=1e-3)
    assert found.compressor_power_w == pytest.approx(8049.01e3 / 1e4 - 200.0)
    assert found.cop == pytest.approx(found.heat_w / found.compressor_power_w)
    # A joule more raises the aging by (1 + b c) / P, a kelvin less lowers it by alpha.
    costs_1_j = (1.0 + 1516.0 * c_rate / (gas * KELVIN)) / power_w
    kelvin_1_j = found.cop / (16 * 228 * 45.0)
    assert found.pays_after_s == pytest.approx(costs_1_j / (per_kelvin * kelvin_1_j), rel=1e-3)
    assert found.cop_to_pay_within(found.pays_after_s) == pytest.approx(found.cop)


def test_braking_gives_back_less_than_the_energy_term_charges() -> None:
    found = printed_cooling(load_parameters("paper_identified").values, KELVIN)
    gas_k = 0.824 * 8.314462618 * 313.15
    c_rate = mean_c_rate_1_h()
    loss_1_ah = 0.824 * 0.0032 ** (1 / 0.824) * 0.001 ** (1 - 1 / 0.824)
    rate_1_ah = loss_1_ah * math.exp((1516.0 * c_rate - 15162.0) / gas_k)
    slope_1_ah = rate_1_ah * (1.0 + 1516.0 * c_rate / gas_k)
    refund = 5e12 * 2.0 * slope_1_ah / 3600.0 / (380.0 * 38.0)
    assert found.braking_refund == pytest.approx(refund, rel=1e-3)
    assert found.braking_refund < 1.0


def mean_c_rate_1_h() -> float:
    """Mean C-rate of the printed reference."""
    return 187082.68e3 / 1e4 / (380.0 * 38.0) / 5.019

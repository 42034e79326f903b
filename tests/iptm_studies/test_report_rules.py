"""Verdict rules against numbers made by hand."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_studies.report.evaluation import NO_CAUSE, evaluate, tally
from iptm_studies.report.measures import change_text, relative_change, share_of_saving
from iptm_studies.report.naming import name_of, names_of
from iptm_studies.report.paper import Claim, PaperClaims
from iptm_studies.report.payback import cooling_payback
from iptm_studies.report.quantities import (
    PowerRegions,
    busiest_window,
    share_while_braking,
    thinned,
    time_to_fall_s,
)
from iptm_studies.report.rules import RULES, Rule
from iptm_studies.report.rules.base import Printed
from iptm_studies.report.runs import Gap, ReportRun, Results
from iptm_studies.report.verdict import Judgement, Tolerance, Verdict, worst

REPRODUCED, SIGN_ONLY, NOT, UNTESTED = Verdict
PARAMETERS = load_parameters().values
ROUTE = build_route("us06", initial_gap_m=15.0, duration_s=60.0)
PRINTED = Printed(
    {
        "strategies/reference": {"traction_energy": 100.0, "cooling_energy": 10.0},
        "strategies/aging": {"traction_energy": 93.0, "cooling_energy": 8.0},
        "strategies/energy_aging": {"traction_energy": 95.0, "cooling_energy": 7.5},
    },
    Tolerance(0.25, 0.01),
)


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
    }
    arrays = {name: np.full(rows, value) for name, value in level.items()}
    arrays["time_s"] = np.arange(float(rows))
    return Trajectory.from_arrays({**arrays, **columns})


def run(
    address: str, measures: Mapping[str, float] | None = None, trajectory: Trajectory | None = None
) -> ReportRun:
    def load() -> Trajectory:
        assert trajectory is not None, "no rule may look into this trajectory"
        return trajectory

    return ReportRun(address, measures or {}, PARAMETERS, ROUTE, STRATEGIES["aging"], load)


def judged(rule: Rule, results: Results) -> Judgement:
    assert results.missing(rule.needs()) == ()
    assert rule.text(PRINTED)
    judgement = rule.judge(results, PRINTED)
    assert judgement.found
    return judgement


def series(key: str, *values: float) -> Results:
    """Runs of the horizon study with one figure."""
    return Results(
        run(f"prediction_horizon/{index}", {key: value}) for index, value in enumerate(values)
    )


def horizons(count: int) -> tuple[str, ...]:
    return tuple(f"prediction_horizon/{index}" for index in range(count))


@pytest.mark.parametrize(
    ("found", "printed", "expected"),
    [
        (-0.07, -0.08, REPRODUCED),
        (-0.061, -0.08, REPRODUCED),
        (-0.059, -0.08, SIGN_ONLY),
        (-0.2, -0.08, SIGN_ONLY),
        (0.01, -0.08, NOT),
        (0.0, -0.08, NOT),
        # Within the floor, but of the other sign.
        (0.001, -0.003, NOT),
        (-0.012, -0.003, REPRODUCED),
    ],
)
def test_change_is_compared_with_the_printed_one(
    found: float, printed: float, expected: Verdict
) -> None:
    results = Results(
        [
            run("strategies/reference", {"traction_energy": 200.0}),
            run("strategies/aging", {"traction_energy": 200.0 * (1.0 + found)}),
        ]
    )
    rule = RULES["change"](
        run="strategies/aging",
        base="strategies/reference",
        measure="traction_energy",
        printed=printed,
    )
    judgement = judged(rule, results)
    assert judgement.verdict is expected
    assert judgement.in_print == change_text(printed)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ((-0.016, -0.027), REPRODUCED),
        ((-0.016, -0.06), SIGN_ONLY),
        ((-0.016, 0.001), NOT),
    ],
)
def test_range_of_changes_is_compared_at_both_ends(
    changes: tuple[float, ...], expected: Verdict
) -> None:
    runs = [run("strategies/aging", {"traction_energy": 100.0})]
    runs += [
        run(f"long_horizon/3+{index}", {"traction_energy": 100.0 * (1.0 + change)})
        for index, change in enumerate(changes)
    ]
    rule = RULES["changes_in_range"](
        runs=tuple(f"long_horizon/3+{index}" for index in range(len(changes))),
        base="strategies/aging",
        measure="traction_energy",
        lowest=-0.0276,
        highest=-0.0158,
    )
    assert judged(rule, Results(runs)).verdict is expected


@pytest.mark.parametrize(
    ("found", "expected"), [(85.0, REPRODUCED), (95.0, SIGN_ONLY), (101.0, NOT)]
)
def test_bound_on_a_reduction(found: float, expected: Verdict) -> None:
    results = Results(
        [
            run("strategies/reference", {"cell_1_degradation": 100.0}),
            run("strategies/aging", {"cell_1_degradation": found}),
        ]
    )
    rule = RULES["change_at_least"](
        run="strategies/aging",
        base="strategies/reference",
        measures=("cell_1_degradation",),
        reduction=0.12,
    )
    assert judged(rule, results).verdict is expected


@pytest.mark.parametrize(
    ("found", "expected"), [(5.0, REPRODUCED), (2.0, SIGN_ONLY), (-0.1, NOT), (0.0, NOT)]
)
def test_printed_value(found: float, expected: Verdict) -> None:
    rule = RULES["value"](
        run="strategies/aging", measure="smallest_margin", printed=5.904, share=0.25, floor=1.0
    )
    results = Results([run("strategies/aging", {"smallest_margin": found})])
    assert judged(rule, results).verdict is expected


def test_bounds_on_values() -> None:
    rule: Any = RULES["value_between"](
        runs=horizons(2), measures=("cell_n_temperature_max",), lowest=39.0, highest=40.0
    )
    assert judged(rule, series("cell_n_temperature_max", 39.0, 40.0)).verdict is REPRODUCED
    assert judged(rule, series("cell_n_temperature_max", 39.0, 40.1)).verdict is NOT
    assert judged(
        replace(rule, highest=None), series("cell_n_temperature_max", 39, 99)
    ).verdict is (REPRODUCED)
    assert judged(rule, series("distance", 39.0, 40.0)).verdict is UNTESTED


def strategies(**traction: float) -> Results:
    return Results(
        run(f"strategies/{name}", {"traction_energy": value, "cooling_energy": 1.0})
        for name, value in traction.items()
    )


def test_all_lower_counts_comparisons_here_and_in_print() -> None:
    rule: Any = RULES["all_lower"](
        lower=("strategies/aging",),
        higher=("strategies/reference", "strategies/energy_aging"),
        measures=("traction_energy",),
    )
    better = judged(rule, strategies(aging=90.0, reference=100.0, energy_aging=95.0))
    assert better.verdict is REPRODUCED
    assert better.found == "2 of 2 comparisons hold"
    assert better.in_print == "2 of 2 comparisons hold"
    equal = judged(rule, strategies(aging=95.0, reference=100.0, energy_aging=95.0))
    assert equal.verdict is NOT
    assert "1 of 2" in equal.found
    assert "Energy + Aging 95.00 kJ" in equal.found
    half = replace(rule, needed_share=0.5)
    assert judged(half, strategies(aging=95.0, reference=100.0, energy_aging=95.0)).verdict is (
        REPRODUCED
    )


def test_many_failures_are_cut_short() -> None:
    rule = RULES["all_lower"](
        lower=horizons(1),
        higher=tuple(f"prediction_horizon/{index}" for index in range(1, 8)),
        measures=("distance",),
    )
    found = judged(rule, series("distance", *[1.0] * 8)).found
    assert found.startswith("0 of 7")
    assert found.endswith("and 3 more")


def test_between_takes_the_ends_in_any_order() -> None:
    rule = RULES["between"](
        run="strategies/energy_aging",
        ends=("strategies/reference", "strategies/aging"),
        measures=("traction_energy",),
    )
    inside = judged(rule, strategies(aging=90.0, reference=100.0, energy_aging=95.0))
    assert inside.verdict is REPRODUCED
    outside = judged(rule, strategies(aging=90.0, reference=94.0, energy_aging=95.0))
    assert outside.verdict is NOT


def test_rank_counts_lower_values() -> None:
    names = ("strategies/aging", "strategies/energy_aging", "strategies/reference")
    rule = RULES["rank"](
        run="strategies/energy_aging", among=names, measures=("traction_energy",), rank=2
    )
    second = judged(rule, strategies(aging=90.0, reference=100.0, energy_aging=95.0))
    assert second.verdict is REPRODUCED
    assert second.in_print == "traction energy: rank 2"
    first = judged(rule, strategies(aging=99.0, reference=100.0, energy_aging=95.0))
    assert first.verdict is NOT


def test_best_choice_ranks_the_means() -> None:
    rule: Any = RULES["best_choice"](
        candidates={
            "2 s": ("prediction_horizon/0", "prediction_horizon/1"),
            "5 s": ("prediction_horizon/2", "prediction_horizon/3"),
        },
        expected=("5 s",),
        measure="distance",
    )
    won = judged(rule, series("distance", 1.0, 5.0, 2.0, 3.0))
    assert won.verdict is REPRODUCED
    assert "best in 1 of 2 groups" in won.found
    assert judged(rule, series("distance", 1.0, 3.0, 2.0, 3.0)).verdict is NOT
    whole = replace(rule, expected=("5 s", "2 s"))
    assert judged(whole, series("distance", 1.0, 5.0, 2.0, 3.0)).verdict is REPRODUCED


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((10.0, 9.0, 8.0), REPRODUCED),
        # A step of less than 0.05 % the other way counts as level.
        ((10.0, 10.004, 8.0), REPRODUCED),
        ((10.0, 11.0, 8.0), SIGN_ONLY),
        ((10.0, 9.99, 9.98), SIGN_ONLY),
        ((10.0, 9.0, 10.0), NOT),
    ],
)
def test_trend_needs_every_step_and_the_size(values: tuple[float, ...], expected: Verdict) -> None:
    rule = RULES["trend"](runs=horizons(3), directions={"distance": "falls"}, least_change=0.01)
    assert judged(rule, series("distance", *values)).verdict is expected


def test_trend_between_the_ends_only() -> None:
    rule = RULES["trend"](runs=horizons(3), directions={"distance": "falls"}, every_step=False)
    assert judged(rule, series("distance", 10.0, 11.0, 8.0)).verdict is REPRODUCED


@pytest.mark.parametrize(
    ("values", "expected"), [((3.0, 2.0, 1.0), NOT), ((3.0, 3.1, 1.0), REPRODUCED)]
)
def test_not_always(values: tuple[float, ...], expected: Verdict) -> None:
    rule = RULES["not_always"](runs=horizons(3), measures=("distance",), direction="falls")
    assert judged(rule, series("distance", *values)).verdict is expected


@pytest.mark.parametrize(
    ("values", "share", "expected"),
    [
        ((1.0, 2.0, 3.0, 4.0), 1.0, REPRODUCED),
        ((1.0, 2.0, 4.0, 3.0), 1.0, NOT),
        ((1.0, 2.0, 4.0, 3.0), 0.5, REPRODUCED),
    ],
)
def test_trend_in_groups(values: tuple[float, ...], share: float, expected: Verdict) -> None:
    rule = RULES["trend_in_groups"](
        groups={"a": horizons(2), "b": ("prediction_horizon/2", "prediction_horizon/3")},
        measure="distance",
        direction="rises",
        needed_share=share,
    )
    assert judged(rule, series("distance", *values)).verdict is expected


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((10.0, 8.0, 7.9), REPRODUCED),
        # Saves as much in the last step, but over twice the distance.
        ((10.0, 9.0, 8.0), REPRODUCED),
        ((10.0, 9.0, 6.0), SIGN_ONLY),
        ((10.0, 9.0, 11.0), NOT),
    ],
)
def test_levelling_off_counts_per_unit(values: tuple[float, ...], expected: Verdict) -> None:
    rule = RULES["levels_off"](
        groups={"a": horizons(3)}, positions=(0.0, 1.0, 3.0), measures=("distance",)
    )
    assert judged(rule, series("distance", *values)).verdict is expected


def test_spread_has_a_lower_or_an_upper_bound() -> None:
    large = RULES["spread"](groups={"a": horizons(2)}, measures=("distance",), at_least=0.05)
    small = RULES["spread"](groups={"a": horizons(2)}, measures=("distance",), at_most=0.05)
    for results, wide in (
        (series("distance", 1.0, 1.1), True),
        (series("distance", 1.0, 1.01), False),
    ):
        assert judged(large, results).verdict is (REPRODUCED if wide else NOT)
        assert judged(small, results).verdict is (NOT if wide else REPRODUCED)


def powers(**runs: Any) -> Results:
    """Runs with the given battery power in kW; row 0 ends no interval."""
    return Results(
        run(
            f"strategies/{name}",
            {"distance": 1.0},
            trip(battery_power_w=np.concatenate([[0.0], 1e3 * np.asarray(values, dtype=float)])),
        )
        for name, values in runs.items()
    )


def test_power_regions_hold_their_share_of_time() -> None:
    results = powers(reference=np.arange(1.0, 101.0), aging=np.full(100, 2.0))
    regions = PowerRegions.of_reference(results["strategies/reference"].trajectory, 50.0, 90.0)
    assert (regions.low_kw, regions.high_kw) == pytest.approx((50.5, 90.1))
    assert regions.shares(results["strategies/reference"].trajectory) == pytest.approx(
        (0.5, 0.4, 0.1)
    )
    assert regions.shares(results["strategies/aging"].trajectory) == pytest.approx((1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("aging", "expected"),
    [
        (np.full(100, 2.0), REPRODUCED),
        # Less time at high power, but none at low power.
        (np.full(100, 60.0), SIGN_ONLY),
        (np.full(100, 95.0), NOT),
    ],
)
def test_power_region_rule(aging: Any, expected: Verdict) -> None:
    rule = RULES["power_regions"](
        run="strategies/aging",
        others=("strategies/reference",),
        reference="strategies/reference",
        low_percentile=50.0,
        high_percentile=90.0,
    )
    assert judged(rule, powers(reference=np.arange(1.0, 101.0), aging=aging)).verdict is expected


def test_lower_peaks() -> None:
    rule = RULES["lower_peaks"](
        run="strategies/aging", others=("strategies/reference",), percentile=99.0
    )
    assert judged(rule, powers(reference=[1.0, 9.0], aging=[1.0, 5.0])).verdict is REPRODUCED
    assert judged(rule, powers(reference=[1.0, 5.0], aging=[1.0, 5.0])).verdict is NOT


@pytest.mark.parametrize(
    ("compressor", "expected"), [(900.0, REPRODUCED), (3000.0, SIGN_ONLY), (9000.0, NOT)]
)
def test_traction_dominates(compressor: float, expected: Verdict) -> None:
    rule = RULES["traction_dominates"](run="strategies/aging", factor=5.0)
    power = np.tile([-6000.0, 6000.0], 6)
    trajectory = trip(
        traction_power_w=power,
        compressor_power_w=np.full(12, compressor),
        auxiliary_power_w=np.full(12, 100.0),
    )
    assert judged(rule, Results([run("strategies/aging", {}, trajectory)])).verdict is expected


@pytest.mark.parametrize(
    ("at_low", "at_high", "braking", "expected"),
    [(500.0, 0.0, 600.0, REPRODUCED), (500.0, 100.0, 50.0, SIGN_ONLY), (0.0, 500.0, 0.0, NOT)],
)
def test_cooling_off_peak(at_low: float, at_high: float, braking: float, expected: Verdict) -> None:
    rule = RULES["cools_off_peak"](
        run="strategies/aging", low_percentile=50.0, high_percentile=90.0
    )
    traction = np.concatenate([[0.0], np.full(20, -1e3), np.full(60, 1e3), np.full(20, 2e4)])
    traction[-5:] = 3e4
    compressor = np.select([traction < 0.0, traction >= 2e4], [braking, at_high], default=at_low)
    trajectory = trip(traction_power_w=traction, compressor_power_w=compressor)
    assert judged(rule, Results([run("strategies/aging", {}, trajectory)])).verdict is expected


def warm(cell_1_c: Any, cell_n_c: Any, traction_w: Any = 0.0) -> Trajectory:
    return trip(
        cell_1_temperature_k=np.asarray(cell_1_c, dtype=float) + 273.15,
        cell_n_temperature_k=np.asarray(cell_n_c, dtype=float) + 273.15,
        traction_power_w=np.broadcast_to(traction_w, np.shape(cell_1_c)).astype(float),
    )


@pytest.mark.parametrize(
    ("end_c", "expected"), [(31.0, REPRODUCED), (33.5, SIGN_ONLY), (36.0, NOT), (27.0, NOT)]
)
def test_settling_temperature(end_c: float, expected: Verdict) -> None:
    rule = RULES["settles_near"](
        run="strategies/aging", printed_c=30.0, tolerance_k=2.0, last_share=0.5
    )
    values = np.concatenate([np.full(10, 35.0), np.full(10, end_c)])
    results = Results([run("strategies/aging", {}, warm(values, values))])
    assert judged(rule, results).verdict is expected


def test_last_cell_falls_slower() -> None:
    rule = RULES["last_cell_falls_slower"](run="strategies/reference", share=0.63)
    times = np.arange(100.0)
    quick, slow = 25.0 + 10.0 * np.exp(-times / 5.0), 25.0 + 10.0 * np.exp(-times / 20.0)
    results = Results([run("strategies/reference", {}, warm(quick, slow))])
    judgement = judged(rule, results)
    assert judgement.verdict is REPRODUCED
    assert judgement.found == "cell 1 5 s, cell N 20 s"
    results = Results([run("strategies/reference", {}, warm(slow, quick))])
    assert judged(rule, results).verdict is NOT


@pytest.mark.parametrize(
    ("after_c", "expected"), [(33.0, REPRODUCED), (30.2, SIGN_ONLY), (29.0, NOT)]
)
def test_demand_heats_the_pack(after_c: float, expected: Verdict) -> None:
    rule = RULES["heats_in_demand"](runs=("strategies/aging",), length_s=10.0, least_rise_k=1.0)
    demand = np.zeros(40)
    demand[21:31] = 1e4
    values = np.interp(np.arange(40.0), [0.0, 20.0, 30.0, 39.0], [35.0, 30.0, after_c, 28.0])
    results = Results([run("strategies/aging", {}, warm(values, values, demand))])
    judgement = judged(rule, results)
    assert judgement.verdict is expected
    assert "from 20 s on" in judgement.found


@pytest.mark.parametrize(
    ("before_c", "expected"), [(30.0, REPRODUCED), (34.0, SIGN_ONLY), (35.0, NOT)]
)
def test_pack_is_cooled_before_demand(before_c: float, expected: Verdict) -> None:
    rule = RULES["cooled_before_demand"](
        runs=("strategies/aging",), length_s=10.0, least_drop_k=2.0
    )
    demand = np.zeros(40)
    demand[21:31] = 1e4
    values = np.interp(np.arange(40.0), [0.0, 20.0], [35.0, before_c])
    results = Results([run("strategies/aging", {}, warm(values, values, demand))])
    assert judged(rule, results).verdict is expected


@pytest.mark.parametrize(
    ("rule", "arguments"),
    [("aging_falls", {}), ("aging_exponential", {"temperature_c": 30.0, "least_excess": 0.5})],
)
def test_aging_model_is_as_the_paper_says(rule: str, arguments: dict[str, float]) -> None:
    assert judged(RULES[rule](**arguments), Results([])).verdict is REPRODUCED


def test_busiest_window_is_found_wherever_it_lies() -> None:
    power = np.zeros(100)
    power[41:51] = 5.0
    power[80] = 7.0
    window = busiest_window(trip(traction_power_w=power), 10.0)
    assert (window.start_row, window.end_row) == (40, 50)
    whole = busiest_window(trip(traction_power_w=power), 1000.0)
    assert (whole.start_row, whole.end_row) == (0, 99)


def test_helpers_of_quantities() -> None:
    times = np.arange(5.0)
    assert time_to_fall_s(times, np.array([10.0, 8.0, 6.0, 2.0, 0.0]), 0.5) == 3.0
    shown, means = thinned(trip(battery_power_w=np.arange(12.0)), np.arange(12.0), 4)
    assert shown.tolist() == [1.0, 4.0, 7.0, 10.0]
    assert means.tolist() == [1.0, 4.0, 7.0, 10.0]


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
    record = replace(run("strategies/aging", {"mean_cop": cop}, trajectory), parameters=parameters)
    found = cooling_payback(record, (50.0,))
    assert found is not None
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
    assert found.times_s[power_w] == pytest.approx(
        per_watt / (per_kelvin * kelvin_per_joule), rel=1e-3
    )
    assert found.cooling_k_kj == pytest.approx(1e3 * kelvin_per_joule)
    assert found.aging_per_kelvin == pytest.approx(per_kelvin, rel=1e-3)


def test_cooling_that_never_ran_pays_never() -> None:
    assert cooling_payback(run("strategies/aging", {}, trip()), (50.0,)) is None
    assert share_while_braking(trip()) is None
    power = np.array([0.0, 100.0, 300.0])
    trajectory = trip(compressor_power_w=power, traction_power_w=np.array([0.0, 5.0, -5.0]))
    assert share_while_braking(trajectory) == pytest.approx(0.75)


def test_figures_in_words() -> None:
    assert change_text(-0.07324) == "-7.32 %"
    assert change_text(None) == "–"
    assert relative_change(1.0, 0.0) is None
    assert share_of_saving(8.0, 10.0, 6.0) == pytest.approx(0.5)
    assert share_of_saving(8.0, 10.0, 11.0) is None
    assert worst([REPRODUCED, SIGN_ONLY]) is SIGN_ONLY
    assert worst([]) is UNTESTED


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("strategies/aging", "Aging (proposed)"),
        ("long_horizon/3+5", "MH 3+5"),
        ("long_horizon/15/reference", "SH 15 Reference"),
        ("imperfect_previews/noise/multi_horizon", "Aging, MH 3+5, noise"),
        ("omitted_parameters/t_init_30_degc/aging", "Aging (proposed), t init 30 °C"),
        ("a_study/of/somebody", "a_study/of/somebody"),
        ("strategies", "strategies"),
    ],
)
def test_runs_in_words(address: str, words: str) -> None:
    assert name_of(address) == words


def test_long_lists_of_runs_are_cut_short() -> None:
    text = names_of([f"prediction_horizon/{index}" for index in range(9)])
    assert text == "9 runs (horizon 0 s to horizon 8 s)"


@pytest.fixture
def paper_of(request: pytest.FixtureRequest) -> Callable[[Rule], PaperClaims]:
    del request

    def make(rule: Rule) -> PaperClaims:
        claim = Claim("the-claim", "group", "Section I", "Something is so.", rule)
        paper: Any = object.__new__(PaperClaims)
        object.__setattr__(paper, "claims", (claim,))
        object.__setattr__(paper, "change_tolerance", PRINTED.change_tolerance)
        table: Any = type("Table", (), {"order": (), "values": {}})
        object.__setattr__(paper, "strategy_table", table)
        return paper

    return make


def test_a_claim_without_its_runs_is_not_tested(
    paper_of: Callable[[Rule], PaperClaims],
) -> None:
    rule = RULES["value_between"](runs=horizons(2), measures=("distance",), lowest=0.0)
    gap = Gap("prediction_horizon/1", "prediction_horizon", "failed: no solution")
    results = Results([run("prediction_horizon/0", {"distance": 1.0})], [gap])
    (entry,) = evaluate(paper_of(rule), results, {"the-claim": "never shown"})
    assert entry.verdict is UNTESTED
    assert entry.judgement.found == (
        "missing runs of Prediction horizon: prediction_horizon/1 (failed: no solution)"
    )
    assert entry.cause == ""
    assert results.gaps == (gap,)


def test_a_cause_is_shown_unless_the_claim_is_reproduced(
    paper_of: Callable[[Rule], PaperClaims],
) -> None:
    rule = RULES["value_between"](runs=horizons(1), measures=("distance",), lowest=1.0)
    good, bad = series("distance", 2.0), series("distance", 0.0)
    (entry,) = evaluate(paper_of(rule), good, {"the-claim": "shown"})
    assert (entry.verdict, entry.cause) == (REPRODUCED, "")
    (entry,) = evaluate(paper_of(rule), bad, {"the-claim": "shown"})
    assert (entry.verdict, entry.cause) == (NOT, "shown")
    (entry,) = evaluate(paper_of(rule), bad, {})
    assert entry.cause == NO_CAUSE
    assert tally([entry]) == {REPRODUCED: 0, SIGN_ONLY: 0, NOT: 1, UNTESTED: 0}

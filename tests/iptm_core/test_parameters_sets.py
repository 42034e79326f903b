"""The shipped sets hold the numbers of the paper and of the named public sources."""

from __future__ import annotations

from dataclasses import replace

import pytest

from iptm_core.parameters import (
    DEFAULT_SET,
    SourceTag,
    available_parameter_sets,
    describe_parameters,
    field_specs,
    flat_to_parameters,
    load_parameters,
    to_flat_dict,
)

# The paper's Tables I and II, typed in from the printed tables.
PRINTED = {
    "body.mass_kg": 1432.0,
    "body.air_density_kg_m3": 1.026,
    "body.drag_coefficient": 0.3,
    "body.frontal_area_m2": 2.22,
    "body.gravity_m_s2": 9.8,
    "body.rotational_inertia_factor": 1.022,
    "body.rolling_resistance": 0.015,
    "powertrain.wheel_radius_m": 0.28,
    "powertrain.driveline_efficiency": 0.9,
    "powertrain.motor_loss_w_per_nm2": 0.873,
    "powertrain.final_drive_ratio": 3.789,
    "powertrain.regenerative_efficiency": 0.3,
    "powertrain.transmission_ratio": 2.80,
    "pack.modules": 16,
    "pack.series_per_module": 6,
    "pack.parallel": 38,
    "pack.open_circuit_voltage_v": 380.0,
    "cell.heat_capacity_j_k": 45.0,
    "cell.nominal_capacity_ah": 5.019,
    "cell.nominal_temperature_k": 288.15,
    "aging.initial_capacity_loss": 0.001,
    "aging.activation_energy_j_mol": 15162.0,
    "aging.pre_exponential_factor": 0.0032,
    "aging.throughput_exponent": 0.824,
    "aging.compensation_factor_j_mol": 1516.0,
    "cooling.convective_coefficient_w_k": 0.4901,
    "cooling.auxiliary_power_w": 200.0,
    "cooling.coolant_mass_flow_kg_s": 0.144,
    "cooling.coolant_specific_heat_j_kg_k": 3330.0,
    "chiller.air_flow_at_rest_kg_s": 0.07065,
    "chiller.air_flow_per_speed_kg_s_per_km_h": 0.001683,
    "limits.min_acceleration_m_s2": -2.0,
    "limits.max_acceleration_m_s2": 2.0,
    "limits.max_jerk_m_s3": 0.5,
    "limits.min_compressor_power_w": 0.0,
    "limits.max_compressor_power_w": 4500.0,
    "limits.max_compressor_rate_w_s": 200.0,
    "limits.min_speed_m_s": 0.0,
    "limits.max_speed_m_s": 37.5,
    "limits.min_temperature_k": 298.15,
    "limits.max_temperature_k": 313.15,
}
COMPLETED = {
    "environment.ambient_temperature_k": (308.15, "chosen"),
    "environment.initial_cell_temperature_k": (308.15, "chosen"),
    "pack.battery_efficiency": (1.0, "derived"),
    "pack.cells_per_channel": (228, "derived"),
    "cell.nominal_resistance_ohm": (0.060, "derived"),
    "cell.resistance_temperature_coefficient_1_k": (-0.008, "chosen"),
    "cell.entropic_coefficient_v_k": (4e-4, "chosen"),
    "cell.resistance_aging_factor": (1.0, "chosen"),
    "cell.resistance_aging_exponent": (1.0, "chosen"),
    "aging.gas_constant_j_mol_k": (8.314462618, "published"),
    "brakes.max_deceleration_m_s2": (8.0, "chosen"),
    "brakes.build_up_m_s3": (10.0, "chosen"),
    "brakes.delay_s": (0.1, "chosen"),
    "brakes.regenerative_deceleration_m_s2": (2.0, "chosen"),
    "gap.standstill_gap_m": (5.0, "chosen"),
    "gap.time_headway_s": (1.5, "chosen"),
    "gap.max_gap_m": (120.0, "chosen"),
    "gap.initial_gap_m": (15.0, "chosen"),
    "chiller.xi_1": (2.2, "derived"),
    "chiller.xi_2_1_w": (-1.6e-4, "derived"),
    "chiller.xi_3_w_k": (-1579.2336767, "derived"),
    "chiller.xi_4_j_kg_k": (4.1710995, "derived"),
    "chiller.xi_5_j_kg_k": (11348.8506087, "derived"),
    "chiller.xi_6_w": (-1396.3143182, "derived"),
    "chiller.gate_power_w": (500.0, "chosen"),
}
# Public chiller map: ambient in degC, xi_1 .. xi_6.
PUBLISHED = [
    (26.0, 1.988324751, -0.000356529, -7840.592905, 26.42555720, 56358.19279, -4723.334273),
    (27.5, 1.978444579, -0.000350255, -7758.147964, 24.91290644, 55768.84387, -4715.082712),
    (29.0, 1.989446763, -0.000348191, -7450.448531, 24.32623575, 53570.54124, -4596.847513),
    (30.5, 1.969746279, -0.000339876, -7374.370321, 23.18094191, 53022.97564, -4568.193666),
    (32.0, 1.940503483, -0.000330907, -7474.235640, 21.97665084, 53730.99985, -4624.944505),
    (33.5, 1.906571584, -0.000320016, -7488.543099, 21.33244436, 53829.40117, -4642.673577),
    (35.0, 1.860278870, -0.000307654, -7665.026122, 20.24473775, 55083.19408, -4722.235131),
    (36.5, 1.821530550, -0.000297712, -7822.045366, 19.55487237, 56200.08998, -4806.465945),
    (38.0, 1.787459582, -0.000288486, -7922.105114, 18.91226613, 56909.54061, -4858.858460),
    (39.5, 1.733949773, -0.000276553, -8224.806160, 18.02412939, 59063.38509, -4990.538277),
]
COEFFICIENTS = ("xi_1", "xi_2_1_w", "xi_3_w_k", "xi_4_j_kg_k", "xi_5_j_kg_k", "xi_6_w")


def coefficients(ambient_k: float) -> tuple[float, ...]:
    chiller = load_parameters(
        "published_chiller", {"environment.ambient_temperature_k": ambient_k}
    ).values.chiller
    return tuple(getattr(chiller, name) for name in COEFFICIENTS)


def test_the_default_set_comes_first() -> None:
    others = (
        "bmw_i3",
        "chevrolet_bolt",
        "paper_identified",
        "published_chiller",
        "tesla_model_3",
        "textbook_cell",
    )
    assert available_parameter_sets() == (DEFAULT_SET, *others)
    assert load_parameters().name == DEFAULT_SET == "paper_calibrated"


@pytest.mark.parametrize("key", PRINTED)
def test_printed_values_are_the_papers(key: str) -> None:
    loaded = load_parameters()
    assert to_flat_dict(loaded.values)[key] == PRINTED[key]
    assert loaded.sources[key].tag is SourceTag.PAPER


@pytest.mark.parametrize("key", COMPLETED)
def test_omitted_values_are_tagged_as_not_from_the_paper(key: str) -> None:
    loaded = load_parameters()
    assert (to_flat_dict(loaded.values)[key], str(loaded.sources[key].tag)) == COMPLETED[key]


def test_the_two_lists_above_cover_the_model() -> None:
    refining = {key for key, spec in field_specs().items() if spec.neutral is not None}
    assert sorted({*PRINTED, *COMPLETED, *refining}) == sorted(field_specs())
    assert refining.isdisjoint(PRINTED)


def test_laws_that_refine_the_paper_are_off_in_its_set() -> None:
    loaded = load_parameters()
    flat = to_flat_dict(loaded.values)
    for key, spec in field_specs().items():
        if spec.neutral is not None:
            assert flat[key] == spec.neutral, key
            assert loaded.sources[key].tag is SourceTag.CHOSEN


def test_a_set_without_the_refining_laws_is_complete() -> None:
    values = load_parameters().values
    old = {
        key: value
        for key, value in to_flat_dict(values).items()
        if field_specs()[key].neutral is None
    }
    assert flat_to_parameters(old) == values


@pytest.mark.parametrize("name", available_parameter_sets())
def test_every_set_states_a_unit_and_a_source_for_every_value(name: str) -> None:
    loaded = load_parameters(name)
    assert list(loaded.sources) == list(field_specs())
    assert all(source.unit for source in loaded.sources.values())
    assert SourceTag.OVERRIDE not in {source.tag for source in loaded.sources.values()}
    assert loaded.description


def test_temperatures_and_speeds_keep_the_unit_they_were_written_in() -> None:
    sources = load_parameters().sources
    assert (
        sources["limits.max_temperature_k"].value,
        sources["limits.max_temperature_k"].unit,
    ) == (
        40.0,
        "degC",
    )
    assert (sources["limits.max_speed_m_s"].value, sources["limits.max_speed_m_s"].unit) == (
        135.0,
        "km/h",
    )


def test_textbook_cell_differs_in_three_numbers_only() -> None:
    default, textbook = load_parameters().values, load_parameters("textbook_cell").values
    assert textbook == replace(
        default,
        cell=replace(
            default.cell,
            nominal_resistance_ohm=0.030,
            resistance_temperature_coefficient_1_k=-0.010,
            entropic_coefficient_v_k=1e-4,
        ),
    )


def test_published_chiller_differs_in_its_coefficients_only() -> None:
    default, published = load_parameters().values, load_parameters("published_chiller").values
    expected = replace(default.chiller, **dict(zip(COEFFICIENTS, PUBLISHED[6][1:], strict=True)))
    assert published == replace(default, chiller=expected)


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: f"{row[0]} degC")
def test_every_row_of_the_published_chiller_is_met_to_the_last_digit(
    row: tuple[float, ...],
) -> None:
    assert coefficients(row[0] + 273.15) == row[1:]


@pytest.mark.parametrize("index", range(len(PUBLISHED) - 1))
@pytest.mark.parametrize("share", [0.25, 0.5, 0.9])
def test_between_the_rows_the_published_chiller_is_linear(index: int, share: float) -> None:
    low, high = PUBLISHED[index], PUBLISHED[index + 1]
    ambient_c = (1.0 - share) * low[0] + share * high[0]
    expected = [(1.0 - share) * a + share * b for a, b in zip(low[1:], high[1:], strict=True)]
    assert coefficients(ambient_c + 273.15) == pytest.approx(expected, rel=1e-11)


def test_the_published_slopes_stay_positive_differences_of_large_numbers() -> None:
    slopes = [row[3] + 0.144 * row[5] for row in PUBLISHED]
    assert min(slopes) > 250.0
    assert slopes[6] == pytest.approx(266.95, abs=0.05)


def test_the_calibrated_chiller_cools_nothing_at_25_degc_without_power() -> None:
    """The ungated map at zero power, 25 degC coolant, 35 degC air and a mean speed of about 45 km/h."""
    chiller = load_parameters().values.chiller
    air = 0.07065 + 0.001683 * 45.0
    slope = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * 0.144
    ungated = slope * 25.0 + chiller.xi_4_j_kg_k * 35.0 * air + chiller.xi_6_w
    assert ungated == pytest.approx(0.0, abs=1.0)


def test_description_rows_show_every_parameter_with_range_and_source() -> None:
    rows = {row.key: row for row in describe_parameters()}
    assert list(rows) == list(field_specs())
    mass = rows["body.mass_kg"]
    assert (mass.symbol, mass.unit, mass.value, mass.source) == ("m", "kg", 1432.0, "paper")
    assert (mass.minimum, mass.maximum) == (100.0, 60000.0)
    assert all(row.minimum <= row.value <= row.maximum for row in rows.values())
    assert "80 and 150 m" in rows["gap.max_gap_m"].note


def test_description_rows_show_the_set_asked_for() -> None:
    rows = {row.key: row for row in describe_parameters(load_parameters("textbook_cell"))}
    assert rows["cell.nominal_resistance_ohm"].value == 0.030
    assert rows["cell.nominal_resistance_ohm"].source == "chosen"

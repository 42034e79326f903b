"""The shipped sets are complete; chiller tables, the published one and a user's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from iptm_core.errors import ParameterError
from iptm_core.parameters import (
    SourceTag,
    available_parameter_sets,
    describe_parameters,
    field_specs,
    flat_to_parameters,
    load_parameters,
    to_flat_dict,
)

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


def test_laws_that_refine_the_paper_are_off_in_its_set() -> None:
    loaded = load_parameters()
    flat = to_flat_dict(loaded.values)
    for key, spec in field_specs().items():
        if not spec.required:
            assert flat[key] == spec.default, key
            assert loaded.sources[key].tag is SourceTag.CHOSEN


def test_a_set_without_the_refining_laws_is_complete() -> None:
    values = load_parameters().values
    old = {key: value for key, value in to_flat_dict(values).items() if field_specs()[key].required}
    assert flat_to_parameters(old) == values


@pytest.mark.parametrize("name", available_parameter_sets())
def test_every_set_states_a_unit_and_a_source_for_every_value(name: str) -> None:
    loaded = load_parameters(name)
    assert list(loaded.sources) == list(field_specs())
    assert all(source.unit for source in loaded.sources.values())
    assert SourceTag.OVERRIDE not in {source.tag for source in loaded.sources.values()}
    assert loaded.description


@pytest.mark.parametrize("index", range(len(PUBLISHED) - 1))
@pytest.mark.parametrize("share", [0.0, 0.25, 0.9])
def test_between_the_rows_the_published_chiller_is_linear(index: int, share: float) -> None:
    low, high = PUBLISHED[index], PUBLISHED[index + 1]
    ambient_c = (1.0 - share) * low[0] + share * high[0]
    expected = [(1.0 - share) * a + share * b for a, b in zip(low[1:], high[1:], strict=True)]
    assert coefficients(ambient_c + 273.15) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("ambient_k", [299.14, 312.66])
def test_the_published_chiller_refuses_other_ambient_temperatures(ambient_k: float) -> None:
    with pytest.raises(ParameterError, match=r"allowed: 299.15 to 312.65 K"):
        coefficients(ambient_k)


def test_the_calibrated_chiller_cools_nothing_at_25_degc_without_power() -> None:
    """The ungated map at zero power, 25 degC coolant, 35 degC air and a mean speed of about 45 km/h."""
    chiller = load_parameters().values.chiller
    air = 0.07065 + 0.001683 * 45.0
    slope = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * 0.144
    ungated = slope * 25.0 + chiller.xi_4_j_kg_k * 35.0 * air + chiller.xi_6_w
    assert ungated == pytest.approx(0.0, abs=1.0)


def test_every_parameter_is_described_with_range_and_source() -> None:
    rows = {row["key"]: row for row in describe_parameters()}
    assert list(rows) == list(field_specs())
    mass = {"key": "body.mass_kg", "symbol": "m", "value": 1432.0, "unit": "kg"}
    mass |= {"minimum": 100.0, "maximum": 60000.0, "source": "paper"}
    assert rows["body.mass_kg"].items() >= mass.items()
    assert all(row["minimum"] <= row["value"] <= row["maximum"] for row in rows.values())
    assert "80 and 150 m" in rows["gap.max_gap_m"]["note"]


COLUMNS = "[ambient_temperature_k, xi_1, xi_2_1_w, xi_3_w_k, xi_4_j_kg_k, xi_5_j_kg_k, xi_6_w]"
UNITS = '[degC, "1", 1/W, W/K, J/(kg K), J/(kg K), W]'
COLD = "[20.0, 2.0, -1e-4, -7000.0, 20.0, 50000.0, -4000.0]"
WARM = "[40.0, 1.0, -3e-4, -7200.0, 10.0, 54000.0, -5000.0]"
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def table(
        *rows: str,
        columns: str = COLUMNS,
        units: str = UNITS,
        base: str = "paper_calibrated",
        more: str = "",
    ) -> Path:
        lines = [
            f"base: {base}",
            "chiller:",
            *([f"  {more}"] if more else []),
            "  by_ambient_temperature:",
            "    source: chosen",
            f"    columns: {columns}",
            f"    units: {units}",
            f"    rows: [{', '.join(rows)}]",
        ]
        path = tmp_path / "table.yaml"
        path.write_text("\n".join(lines) + "\n")
        return path

    return table


def test_a_users_table_is_interpolated_at_the_ambient_temperature(write: Write) -> None:
    loaded = load_parameters(write(COLD, WARM))
    assert loaded.values.chiller.xi_1 == pytest.approx(2.0 - 15.0 / 20.0, rel=1e-12)
    assert loaded.values.chiller.xi_5_j_kg_k == pytest.approx(53000.0, rel=1e-12)
    assert loaded.sources["chiller.xi_1"].tag is SourceTag.CHOSEN
    assert loaded.values.chiller.gate_power_w == 500.0


def test_columns_may_stand_in_any_order(write: Write) -> None:
    path = write(
        "[2.0, 20.0, -1e-4, -7000.0, 20.0, 50000.0, -4000.0]",
        "[1.0, 40.0, -3e-4, -7200.0, 10.0, 54000.0, -5000.0]",
        columns="[xi_1, ambient_temperature_k, xi_2_1_w, xi_3_w_k, xi_4_j_kg_k, xi_5_j_kg_k, xi_6_w]",
        units='["1", degC, 1/W, W/K, J/(kg K), J/(kg K), W]',
    )
    assert load_parameters(path).values.chiller.xi_1 == pytest.approx(1.25, rel=1e-12)


def test_a_table_replaces_the_coefficients_of_its_base_and_the_other_way_round(
    write: Write, tmp_path: Path
) -> None:
    assert load_parameters(write(COLD, WARM, base="published_chiller")).values.chiller.xi_6_w == (
        pytest.approx(-4750.0, rel=1e-12)
    )
    single = tmp_path / "single.yaml"
    single.write_text(
        'base: published_chiller\nchiller:\n  xi_1: {value: 2.0, unit: "1", source: chosen}\n'
    )
    chiller = load_parameters(single).values.chiller
    assert (chiller.xi_1, chiller.xi_6_w) == (2.0, -4722.235131)


def test_a_row_is_met_although_its_conversion_rounds(write: Write) -> None:
    at_the_edge = {"environment.ambient_temperature_k": 293.15 - 1e-12}
    assert load_parameters(write(COLD, WARM), at_the_edge).values.chiller.xi_1 == 2.0


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([COLD], "rows is [["),
        ([WARM, COLD], "allowed: increasing ones"),
        ([COLD, "[40.0, 1.0]"], "row 2 is [40.0, 1.0]; allowed: a list of 7 numbers"),
        ([COLD, WARM.replace("1.0,", "true,", 1)], "row 2: chiller.xi_1 is True, no number"),
        ([COLD, WARM.replace("1.0,", ".nan,", 1)], "row 2: chiller.xi_1 is nan; allowed"),
        ([COLD, WARM.replace("40.0", "140.0")], "is 140.0 degC = 413.15 K; allowed"),
    ],
)
def test_wrong_rows(write: Write, rows: list[str], message: str) -> None:
    path = write(*rows)
    with pytest.raises(ParameterError) as caught:
        load_parameters(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ({"columns": "5"}, "columns is "),
        ({"columns": COLUMNS.replace("xi_6_w", "xi_7")}, "column 'xi_7'; did you mean 'xi_1'?"),
        ({"columns": COLUMNS.replace("xi_6_w", "xi_1")}, "xi_6_w once"),
        ({"units": "[degC]"}, "units is ['degC']; allowed: a list of 7 units"),
        ({"units": UNITS.replace("1/W", "1/kW")}, "-0.0001 with unit '1/kW'; allowed: '1/W'"),
        ({"units": UNITS.replace("degC", "[degC]")}, "unit ['degC']; allowed: 'K' or 'degC'"),
        ({"more": 'xi_1: {value: 2.0, unit: "1", source: chosen}'}, "both state the chiller"),
    ],
)
def test_wrong_headings(write: Write, written: dict[str, str], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(write(COLD, WARM, **written))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("5", "chiller.by_ambient_temperature holds 5; allowed: a mapping"),
        ("{rows: []}", "chiller.by_ambient_temperature: 'source' is missing"),
        ("{source: paper, row: []}", "unknown entry 'row'; did you mean 'rows'?"),
        ("{source: paper}", "columns is None; allowed: a list"),
    ],
)
def test_a_table_that_is_none(tmp_path: Path, entry: str, message: str) -> None:
    path = tmp_path / "table.yaml"
    path.write_text(f"base: paper_calibrated\nchiller:\n  by_ambient_temperature: {entry}\n")
    with pytest.raises(ParameterError) as caught:
        load_parameters(path)
    assert message in str(caught.value)


def test_a_table_needs_an_ambient_temperature(write: Write) -> None:
    path = write(COLD, WARM)
    path.write_text(path.read_text().removeprefix("base: paper_calibrated\n"))
    with pytest.raises(ParameterError, match=r"missing environment\.ambient_temperature_k"):
        load_parameters(path)

"""A chiller table in a user's file: what it may look like, and how it meets its base."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from iptm_core.errors import ParameterError
from iptm_core.parameters import SourceTag, load_parameters

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

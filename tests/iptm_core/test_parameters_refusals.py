"""Every way to get parameters wrong, in files, overrides and together, and the sentence it ends in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.settings import ModelSettings

BASE = "base: paper_calibrated\n"
Refuse = Callable[..., str]


@pytest.fixture
def refuse(tmp_path: Path) -> Refuse:
    """Write a file, load it, and return the message after the file name."""

    def load(text: str, overrides: dict[str, float] | None = None) -> str:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ParameterError) as caught:
            load_parameters(path, overrides)
        message = str(caught.value)
        assert message.startswith(str(path)), message
        return message.removeprefix(str(path))

    return load


def mass(entry: str) -> str:
    return f"{BASE}body:\n  mass_kg: {entry}\n"


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ("{value: heavy, unit: kg, source: chosen}", "body.mass_kg is 'heavy', no number"),
        ("{value: true, unit: kg, source: chosen}", "body.mass_kg is True, no number"),
        (
            "{value: .nan, unit: kg, source: chosen}",
            "body.mass_kg is nan; allowed: 100 to 60000 kg",
        ),
        (f"{{value: {10**400}, unit: kg, source: chosen}}", "body.mass_kg is 1000"),
        (
            "{value: 99.9, unit: kg, source: chosen}",
            "body.mass_kg is 99.9; allowed: 100 to 60000 kg",
        ),
        ("{value: 1432.0, unit: g, source: chosen}", "unit 'g'; allowed: 'kg'"),
        ("{value: 1432.0, unit: 1, source: chosen}", "body.mass_kg: unit is 1"),
        ("{value: 1432.0, source: chosen}", "body.mass_kg: 'unit' is missing"),
        ("{value: 1432.0, unit: kg}", "body.mass_kg: 'source' is missing"),
        ("{value: 1432.0, unit: kg, source: guessed}", "source is 'guessed'; allowed: paper, "),
        ("{value: 1432.0, unit: kg, source: override}", "source is 'override'; allowed: paper, "),
        ("{value: 1432.0, unit: kg, source: paper, note: 3}", "body.mass_kg: note is 3"),
        ("{value: 1432.0, units: kg, source: paper}", "entry 'units'; did you mean 'unit'?"),
        ("1432.0", "body.mass_kg is 1432.0; allowed: {value: ..., unit: kg, source: ...}"),
    ],
)
def test_a_wrong_entry(refuse: Refuse, entry: str, named: str) -> None:
    message = refuse(mass(entry))
    assert named in message
    assert "allowed: " in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", " holds nothing; allowed: a mapping"),
        ("- 1\n- 2\n", " holds [1, 2]"),
        (BASE + "bodi:\n  mass_kg: 1\n", ": unknown group 'bodi'; did you mean 'body'?"),
        (BASE + "body: 5\n", ": body holds 5; allowed: a mapping"),
        (BASE + "body:\n  mas_kg: 1\n", "'body.mas_kg'; did you mean 'body.mass_kg'?"),
        (BASE + "description: [a]\n", ": description is ['a']; allowed: a text"),
        ("base: 3\n", ": base is 3; allowed: a text"),
        (
            "base: paper_calibratet\n",
            "'paper_calibratet', no shipped set and no file; did you mean",
        ),
        (mass("{value: 1432.0, unit: kg, source: paper"), ": not valid YAML: "),
        ("body: {\t}\n\tx", ": not valid YAML: "),
        ("body: &a [*a]\nbase: *b\n", ": not valid YAML: "),
        ("!!python/object:os.system {}\n", ": not valid YAML: "),
        ("a: 1\n---\nb: 2\n", ": not valid YAML: "),
        ("[" * 5000, ": not valid YAML: nested more than 50 deep"),
        (f"{BASE}{BASE}", "the key 'base' occurs twice"),
        (mass("{value: 1.0, value: 2.0, unit: kg, source: paper}"), "the key 'value' occurs twice"),
        (BASE + "? [a]\n: 1\n", "a key must be plain text, got ['a']"),
        (
            BASE + "gap:\n  max_gap_m: {value: " + "9" * 5000 + ", unit: m, source: chosen}\n",
            ": not valid YAML: ",
        ),
    ],
)
def test_a_wrong_file(refuse: Refuse, text: str, named: str) -> None:
    assert named in refuse(text)


@pytest.mark.parametrize("written", ["1_000", "010", "1:30", "0x10", "'1432'", "yes", "1.5.2"])
def test_numbers_that_yaml_1_1_would_guess_are_refused(refuse: Refuse, written: str) -> None:
    assert "no number; allowed: 100 to 60000 kg" in refuse(
        mass(f"{{value: {written}, unit: kg, source: paper}}")
    )


@pytest.mark.parametrize("written", ["2e3", "2E+3", "2000", "2000.", "+2000.0", "2.e3"])
def test_numbers_in_every_usual_notation_are_read(tmp_path: Path, written: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(mass(f"{{value: {written}, unit: kg, source: chosen}}"))
    loaded = load_parameters(path)
    assert (loaded.name, loaded.values.body.mass_kg) == ("mine", 2000.0)


def test_a_converted_value_is_shown_in_both_units(refuse: Refuse) -> None:
    hot = "limits:\n  max_temperature_k: {value: 100.0, unit: degC, source: chosen}\n"
    assert (
        "limits.max_temperature_k is 100.0 degC = 373.15 K; allowed: 263.15 to 353.15 K"
        in refuse(BASE + hot)
    )
    knots = "limits:\n  max_speed_m_s: {value: 60.0, unit: kn, source: chosen}\n"
    assert "unit 'kn'; allowed: 'm/s' or 'km/h'" in refuse(BASE + knots)
    slope = "cell:\n  entropic_coefficient_v_k: {value: 1e-4, unit: degC, source: chosen}\n"
    assert "unit 'degC'; allowed: 'V/K'" in refuse(BASE + slope)


def test_a_set_without_base_must_be_complete(refuse: Refuse) -> None:
    text = mass("{value: 1432.0, unit: kg, source: paper}").removeprefix(BASE)
    message = refuse(text)
    assert ": missing body.gravity_m_s2, body.rolling_resistance, " in message
    assert message.endswith(" more")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="not a regular file"):
        load_parameters(tmp_path)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"description: \xff\xfe\n")
    with pytest.raises(ParameterError, match=r"latin\.yaml: cannot be read as UTF-8 text"):
        load_parameters(latin)
    huge = tmp_path / "huge.yaml"
    huge.write_bytes(b" " * 4_000_001)
    with pytest.raises(ParameterError, match="4000001 bytes; at most 500000 are read"):
        load_parameters(huge)


def test_a_file_may_build_on_another_file_but_not_on_itself(tmp_path: Path) -> None:
    (tmp_path / "inner.yaml").write_text(mass("{value: 1500.0, unit: kg, source: chosen}"))
    outer = tmp_path / "outer.yaml"
    outer.write_text(
        "base: inner.yaml\ngap:\n  max_gap_m: {value: 80.0, unit: m, source: chosen}\n"
    )
    values = load_parameters(str(outer)).values
    assert (values.body.mass_kg, values.gap.max_gap_m) == (1500.0, 80.0)
    (tmp_path / "inner.yaml").write_text("base: outer.yaml\n")
    with pytest.raises(ParameterError, match="build on each other in a circle"):
        load_parameters(outer)
    for level in range(9):
        (tmp_path / f"level_{level}.yaml").write_text(f"base: level_{level + 1}.yaml\n")
    with pytest.raises(ParameterError, match="more than 8 deep"):
        load_parameters(tmp_path / "level_0.yaml")


NAMES = ["body", "chiller", "mass_kg", "xi_1", "by_ambient_temperature", "rows", "value", "unit"]
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(document=JUNK, with_base=st.booleans())
def test_whatever_the_file_holds_it_loads_or_is_refused(
    tmp_path: Path, document: Any, with_base: bool
) -> None:
    if with_base and isinstance(document, dict):
        document = {"base": "paper_calibrated", **document}
    path = tmp_path / "junk.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    message = ""
    try:
        load_parameters(path)
    except ParameterError as error:
        message = str(error)
    assert not message or str(path) in message


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(max_size=60))
def test_whatever_the_text_is_it_loads_or_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "text.yaml"
    path.write_bytes(text.encode("utf-8", errors="surrogatepass"))
    with pytest.raises(ParameterError):
        load_parameters(path)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"limits.max_speed_m_s": 5.0, "limits.min_speed_m_s": 5.0},
            "limits.min_speed_m_s is 5.0; allowed: ",
        ),
        ({"limits.min_compressor_power_w": 4500.0}, "below limits.max_compressor_power_w = 4500.0"),
        ({"limits.min_temperature_k": 314.0}, "below limits.max_temperature_k = 313.15"),
        ({"gap.standstill_gap_m": 30.0, "gap.max_gap_m": 20.0}, "below gap.max_gap_m = 20.0"),
        ({"gap.initial_gap_m": 4.0}, "from gap.standstill_gap_m to gap.max_gap_m, 5.0 to 120.0 m"),
        ({"gap.initial_gap_m": 130.0}, "gap.initial_gap_m is 130.0; allowed: "),
        (
            {"brakes.max_deceleration_m_s2": 1.0},
            "brakes.max_deceleration_m_s2 is 1.0; allowed: from",
        ),
        ({"charge.voltage_share_30": 1.2}, "voltage_share_40 is 1.0; allowed: at least"),
        ({"charge.initial_charge": 0.05}, "charge.min_charge is 0.1; allowed: below"),
        (
            {"regeneration.blend_start_m_s": 3.0},
            "regeneration.blend_start_m_s is 3.0; allowed: below",
        ),
        ({"cooling.convective_coefficient_w_k": 30.0}, "of one coolant channel, 29.97 W/K"),
        ({"cooling.coolant_mass_flow_kg_s": 0.002}, "h/C_f = 1.17742; allowed: below 1"),
        ({"cooling.coolant_mass_flow_kg_s": 0.13}, "flow that they were fitted at"),
        (
            {
                "cell.resistance_temperature_coefficient_1_k": -0.03,
                "environment.initial_cell_temperature_k": 330.0,
            },
            "vanish at environment.initial_cell_temperature_k = 330.0",
        ),
        ({"pack.open_circuit_voltage_v": 11.0}, "gives an entropic voltage of 11.4"),
    ],
)
def test_parameters_that_contradict_each_other(overrides: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(overrides=overrides)
    assert message in str(caught.value)
    assert "paper_calibrated.yaml with overrides: " in str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"gap.max_gap": 80.0},
            "overrides: unknown parameter 'gap.max_gap'; did you mean 'gap.max_gap_m'?",
        ),
        ({"zzz": 1.0}, "overrides: unknown parameter 'zzz'; allowed: body.mass_kg, "),
        (
            {"pack.modules": 1.5},
            "overrides: pack.modules is 1.5; allowed: whole numbers from 1 to 1000",
        ),
        (
            [("gap.max_gap_m", 80.0)],
            "overrides holds [('gap.max_gap_m', 80.0)]; allowed: a mapping",
        ),
    ],
)
def test_wrong_overrides(overrides: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(overrides=overrides)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "textbook",
            "parameter set is 'textbook', no shipped set and no file; did you mean 'textbook_cell'?",
        ),
        ("", "parameter set is ''; allowed: a path, or a shipped set: paper_calibrated, "),
        (7, "parameter set is 7; allowed: a path"),
        ("nowhere.yaml", "nowhere.yaml: no such file"),
        ("x" * 300, "no shipped set and no file; allowed: paper_calibrated, "),
        ("y" * 300 + ".yaml", "cannot be read: "),
    ],
)
def test_sets_that_do_not_exist(name: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(name)
    assert message in str(caught.value)


def test_a_set_for_one_purpose_is_refused_unless_its_parameter_is_stated(
    refuse: Refuse, tmp_path: Path
) -> None:
    """Also through a set that builds on it."""
    text = BASE + "refused_without: {chiller.gate_power_w: cools with the compressor off}\n"
    message = (
        ": cools with the compressor off; allowed: with an override of chiller.gate_power_w only"
    )
    assert refuse(text) == message
    assert refuse(text, {"body.mass_kg": 1500.0}) == message
    path = tmp_path / "mine.yaml"
    assert load_parameters(path, {"chiller.gate_power_w": 0.0}).values.chiller.gate_power_w == 0.0
    (tmp_path / "above.yaml").write_text("base: mine.yaml\n", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"above\.yaml: cools with the compressor off"):
        load_parameters(tmp_path / "above.yaml")
    assert "unknown parameter" in refuse(BASE + "refused_without: {chiller.gate: cools}\n")


@pytest.mark.parametrize("watts", ["0", "0.0", "-0.0"])
def test_nodes_and_demos_refuse_a_chiller_that_cools_with_the_compressor_off(watts: str) -> None:
    with pytest.raises(ParameterError, match=r"gate_power_w is 0, .*; allowed: above 0 W in nodes"):
        ModelSettings(overrides=f"chiller.gate_power_w={watts}").model()
    ModelSettings(overrides="chiller.gate_power_w=1").model()

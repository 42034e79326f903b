"""Overrides, the flat form, and its way through YAML and JSON and back, bit by bit."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import fields

import numpy as np
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

from iptm_core.declaration import ParameterSpec
from iptm_core.errors import ParameterError
from iptm_core.parameters import (
    ModelParameters,
    SourceTag,
    available_parameter_sets,
    field_specs,
    flat_to_parameters,
    load_parameters,
    to_flat_dict,
)
from iptm_core.parameters.loading import parse_overrides
from iptm_core.parameters.strict_yaml import parse_yaml

SPECS = list(field_specs().values())
DEFAULTS = to_flat_dict(load_parameters().values)


def numbers_in_range(spec: ParameterSpec) -> st.SearchStrategy[float]:
    if spec.kind is int:
        return st.integers(int(spec.minimum), int(spec.maximum))
    return st.floats(spec.minimum, spec.maximum, allow_subnormal=False)


@st.composite
def flat_parameters(draw: st.DrawFn) -> dict[str, float]:
    """Defaults with up to four parameters moved anywhere in their range."""
    moved = draw(st.lists(st.sampled_from(SPECS), max_size=4, unique=True))
    return DEFAULTS | {spec.name: draw(numbers_in_range(spec)) for spec in moved}


def bits(flat: dict[str, float]) -> dict[str, str]:
    return {key: float(value).hex() for key, value in flat.items()}


@pytest.mark.parametrize("name", available_parameter_sets())
def test_shipped_sets_survive_the_flat_form(name: str) -> None:
    values = load_parameters(name).values
    assert flat_to_parameters(to_flat_dict(values)) == values


def test_the_flat_form_has_every_field_once() -> None:
    groups = [group.name for group in fields(ModelParameters)]
    assert len(DEFAULTS) == len(SPECS)
    assert {key.split(".")[0] for key in DEFAULTS} == set(groups)
    assert all(isinstance(value, int | float) for value in DEFAULTS.values())


@given(flat_parameters())
def test_the_flat_form_survives_yaml_and_json_bit_by_bit(flat: dict[str, float]) -> None:
    try:
        values = flat_to_parameters(flat)
    except ParameterError:
        assume(False)  # numbers that are fine alone and contradict each other
    written = to_flat_dict(values)
    assert bits(written) == bits(flat)
    text = yaml.safe_dump(written)
    for read in (yaml.safe_load(text), parse_yaml(text, "bag"), json.loads(json.dumps(written))):
        assert bits(read) == bits(flat)
        assert flat_to_parameters(read) == values


@given(st.data())
def test_any_number_in_range_is_taken_as_an_override(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    number = data.draw(numbers_in_range(spec))
    try:
        loaded = load_parameters(overrides={spec.name: number})
    except ParameterError as error:  # it may still contradict another parameter
        if str(error).startswith("overrides: "):
            raise
        return
    assert bits(to_flat_dict(loaded.values)) == bits(DEFAULTS | {spec.name: number})
    assert loaded.sources[spec.name].tag is SourceTag.OVERRIDE
    assert loaded.sources[spec.name].value == number


@given(st.data())
def test_any_number_out_of_range_is_refused_with_key_value_and_range(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    ends = [end + sign * 1e-8 * abs(end) for end, sign in ((spec.minimum, -1), (spec.maximum, 1))]
    below = st.floats(max_value=math.nextafter(ends[0], -math.inf), allow_infinity=False)
    above = st.floats(min_value=math.nextafter(ends[1], math.inf), allow_infinity=False)
    number = data.draw(below | above)
    with pytest.raises(ParameterError) as caught:
        load_parameters(overrides={spec.name: number})
    message = str(caught.value)
    assert message.startswith(f"overrides: {spec.name} is {number!r}")
    assert f"{spec.minimum:g} to {spec.maximum:g}" in message


@pytest.mark.parametrize(("key", "celsius"), [("initial_cell", -20.0), ("ambient", -40.0)])
def test_the_round_off_of_a_conversion_is_not_out_of_range(key: str, celsius: float) -> None:
    name = f"environment.{key}_temperature_k"
    kelvin = celsius + 273.15
    assert kelvin < round(kelvin, 2)
    assert to_flat_dict(load_parameters(overrides={name: kelvin}).values)[name] == round(kelvin, 2)


def test_an_overridden_coefficient_is_not_interpolated_away() -> None:
    loaded = load_parameters(
        "published_chiller", {"chiller.xi_1": 2.0, "environment.ambient_temperature_k": 311.15}
    )
    assert loaded.values.chiller.xi_1 == 2.0
    assert loaded.values.chiller.xi_6_w == -4858.858460


def test_whole_numbers_come_back_as_int_and_numpy_numbers_are_taken() -> None:
    loaded = load_parameters(
        overrides={
            "pack.modules": np.float64(8.0),
            "pack.parallel": np.int64(40),
            "gap.max_gap_m": 80,
        }
    )
    assert loaded.values.pack.modules == 8
    assert type(loaded.values.pack.modules) is int
    assert type(loaded.values.pack.parallel) is int
    assert type(loaded.values.gap.max_gap_m) is float


def test_a_set_can_be_sent_to_another_process() -> None:
    loaded = load_parameters("published_chiller", {"gap.max_gap_m": 80.0})
    assert pickle.loads(pickle.dumps(loaded)) == loaded  # noqa: S301  (bytes made one line above)
    assert hash(loaded) == hash(pickle.loads(pickle.dumps(loaded)))  # noqa: S301


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"body.mass": 1500.0}, "unknown parameter 'body.mass'; did you mean 'body.mass_kg'?"),
        ({17: 1.0}, "parameter 17; allowed: a text"),
        ({"body.mass_kg": None}, "body.mass_kg is None, no number; allowed: 100 to 60000 kg"),
        ({"body.mass_kg": float("nan")}, "body.mass_kg is nan; allowed: "),
        ({"pack.modules": 15.5}, "pack.modules is 15.5; allowed: whole numbers "),
    ],
)
def test_a_flat_mapping_is_checked_like_a_file(change: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        flat_to_parameters(DEFAULTS | change, origin="trip.mcap")
    assert str(caught.value).startswith("trip.mcap: ")
    assert message in str(caught.value)


def test_a_flat_mapping_names_what_is_missing() -> None:
    with pytest.raises(ParameterError, match=r"missing cell\.heat_capacity_j_k, gap\.max_gap_m$"):
        flat_to_parameters(
            {
                key: value
                for key, value in DEFAULTS.items()
                if key not in {"gap.max_gap_m", "cell.heat_capacity_j_k"}
            }
        )
    with pytest.raises(ParameterError, match=r"missing body\.mass_kg, .* and \d+ more$"):
        flat_to_parameters({})
    with pytest.raises(ParameterError, match="holds 5; allowed: a mapping"):
        flat_to_parameters(5)  # type: ignore[arg-type]


def test_overrides_written_as_one_line() -> None:
    assert parse_overrides("") == {}
    assert parse_overrides(" body.mass_kg = 1600 ,gap.max_gap_m=8e1,") == {
        "body.mass_kg": 1600.0,
        "gap.max_gap_m": 80.0,
    }


@pytest.mark.parametrize(
    "text", ["body.mass_kg", "=3", "gap.max_gap_m=far", "gap.max_gap_m=1,gap.max_gap_m=2", "a=1=2"]
)
def test_a_malformed_line_of_overrides_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="parameter overrides have the entry"):
        parse_overrides(text)


def test_a_parameter_of_former_versions_may_stand_where_it_changed_nothing() -> None:
    assert flat_to_parameters(DEFAULTS | {"gap.leader_return_s": 0.0}) == flat_to_parameters(
        DEFAULTS
    )
    with pytest.raises(ParameterError, match="leader_return_s"):
        flat_to_parameters(DEFAULTS | {"gap.leader_return_s": 12.0})

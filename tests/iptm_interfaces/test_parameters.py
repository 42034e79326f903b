from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from iptm_core.errors import ParameterError
from iptm_interfaces.parameters import (
    ParameterSpec,
    checked_value,
    declare_parameters,
    overrides_for,
    parameter,
    parameter_specs,
    parameter_table_markdown,
)


@dataclass(frozen=True)
class Example:
    latency_s: float = parameter(0.5, "age on arrival", "s", 0.0, 60.0)
    retries: int = parameter(3, "attempts", "", 0, 10)
    mode: str = parameter("full", "how much", choices=("full", "none"))
    enabled: bool = parameter(True, "whether at all")
    steps_s: tuple[float, ...] = parameter((1.0, 5.0), "grid", "s", 0.1)
    title: str = parameter("", "free text")


MakeNode = Callable[..., Any]


def declare(make_node: MakeNode, *overrides: str) -> Example:
    arguments = [part for override in overrides for part in ("-p", override)]
    return declare_parameters(make_node(*arguments), Example)


def test_defaults_without_overrides(make_node: MakeNode) -> None:
    assert declare(make_node) == Example()


def test_overrides_of_every_type(make_node: MakeNode) -> None:
    got = declare(
        make_node, "latency_s:=2.5", "retries:=7", "mode:=none", "enabled:=false",
        "steps_s:=[0.5, 2.0, 8.0]", "title:=a b",
    )  # fmt: skip
    assert got == Example(2.5, 7, "none", False, (0.5, 2.0, 8.0), "a b")


def test_whole_numbers_are_welcome_for_floats(make_node: MakeNode) -> None:
    got = declare(make_node, "latency_s:=2", "steps_s:=[1, 2]")
    assert got.latency_s == 2.0
    assert got.steps_s == (1.0, 2.0)
    assert all(type(step) is float for step in (got.latency_s, *got.steps_s))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "latency_s:=-1.0",
            "parameter latency_s is -1.0 (float); allowed: a number from 0 to 60 s",
        ),
        ("latency_s:=.nan", "parameter latency_s is nan (float)"),
        ("latency_s:=.inf", "parameter latency_s is inf (float)"),
        ("latency_s:=soon", "parameter latency_s is 'soon' (text)"),
        ("latency_s:=true", "parameter latency_s is True (bool)"),
        ("retries:=2.0", "retries is 2.0 (float); allowed: a whole number from 0 to 10"),
        ("retries:=11", "retries is 11 (integer)"),
        ("retries:=true", "retries is True (bool)"),
        ("mode:=some", "mode is 'some' (text); allowed: one of full, none"),
        ("mode:=1", "mode is 1 (integer)"),
        ("enabled:=1", "enabled is 1 (integer); allowed: true or false"),
        ("steps_s:=[1.0, 0.0]", "allowed: a list, each a number, at least 0.1 s"),
        ("steps_s:=3.0", "steps_s is 3.0 (float)"),
        ("steps_s:=[a, b]", "steps_s is ['a', 'b'] (list)"),
    ],
)
def test_wrong_override_is_one_clear_line(make_node: MakeNode, override: str, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        declare(make_node, override)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_parameter_file_with_wildcard(make_node: MakeNode, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters:\n    latency_s: 4\n    mode: none\n")
    got = declare_parameters(make_node("--params-file", str(file)), Example)
    assert (got.latency_s, got.mode) == (4.0, "none")


def test_descriptors_tell_unit_and_range_and_forbid_changes(make_node: MakeNode) -> None:
    node = make_node("-p", "latency_s:=2.0")
    declare_parameters(node, Example)
    latency = node.describe_parameter("latency_s")
    assert latency.description == "age on arrival [s]"
    assert latency.read_only
    limits = latency.floating_point_range[0]
    assert (limits.from_value, limits.to_value) == (0.0, 60.0)
    retries = node.describe_parameter("retries").integer_range[0]
    assert (retries.from_value, retries.to_value) == (0, 10)
    assert node.describe_parameter("mode").additional_constraints == "one of full, none"
    assert node.get_parameter("latency_s").value == 2.0


def test_prefix_moves_the_names(make_node: MakeNode) -> None:
    node = make_node("-p", "link.latency_s:=1.5")
    assert declare_parameters(node, Example, prefix="link.").latency_s == 1.5


def test_unknown_override_is_refused_with_a_suggestion(make_node: MakeNode) -> None:
    node = make_node("-p", "latncy_s:=1.0")
    declare_parameters(node, Example)
    with pytest.raises(ParameterError, match=r"latncy_s is unknown .* did you mean latency_s\?"):
        node.reject_unknown_parameters()


def test_parameters_of_ros_itself_are_not_unknown(make_node: MakeNode) -> None:
    node = make_node("-p", "use_sim_time:=true")
    declare_parameters(node, Example)
    node.reject_unknown_parameters()


@pytest.mark.parametrize(
    ("minimum", "maximum", "allowed"),
    [
        (1.0, float("inf"), "a number, at least 1 m"),
        (float("-inf"), 2.0, "a number, at most 2 m"),
        (float("-inf"), float("inf"), "a number"),
    ],
)
def test_open_ranges_in_words(minimum: float, maximum: float, allowed: str) -> None:
    spec = ParameterSpec("x_m", 1.5, "x", "m", minimum, maximum)
    assert spec.allowed == allowed
    assert checked_value(spec, 1) == 1.0


def test_mapping_for_a_parameter_file_gives_the_same_instance(
    make_node: MakeNode, tmp_path: Path
) -> None:
    wanted = Example(1.25, 4, "none", True, (2.0,), "x")
    lines = [f"    {name}: {value!r}" for name, value in overrides_for(wanted).items()]
    file = tmp_path / "p.yaml"
    text = "\n".join(["/**:", "  ros__parameters:", *lines]).replace("True", "true")
    file.write_text(text + "\n")
    assert declare_parameters(make_node("--params-file", str(file)), Example) == wanted


def test_table_lists_every_parameter() -> None:
    table = parameter_table_markdown(parameter_specs(Example))
    assert "| `latency_s` | `0.5` | s | a number from 0 to 60 s | age on arrival |" in table
    assert table.count("\n") == 2 + len(parameter_specs(Example))

"""Declared parameters on a real node: overrides, files, descriptors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_ros.parameters import declare_parameters


class Mode(str, Enum):
    FULL = "full"
    NONE = "none"


@dataclass(frozen=True)
class Example(Settings):
    latency_s: float = parameter(0.5, "age on arrival", "s", 0.0, 60.0)
    retries: int = parameter(3, "attempts", "", 0, 10)
    mode: Mode = parameter(Mode.FULL, "how much")
    enabled: bool = parameter(default=True, description="whether at all")
    title: str = parameter("", "free text")


MakeNode = Callable[..., Any]


def declare(make_node: MakeNode, *overrides: str) -> Example:
    arguments = [part for override in overrides for part in ("-p", override)]
    return declare_parameters(make_node(*arguments), Example)


def test_defaults_without_overrides(make_node: MakeNode) -> None:
    assert declare(make_node) == Example()


def test_overrides_of_every_type(make_node: MakeNode) -> None:
    got = declare(
        make_node, "latency_s:=2.5", "retries:=7", "mode:=none", "enabled:=false", "title:=a b"
    )
    assert got == Example(2.5, 7, Mode.NONE, False, "a b")


def test_whole_numbers_are_welcome_for_floats(make_node: MakeNode) -> None:
    got = declare(make_node, "latency_s:=2")
    assert got.latency_s == 2.0
    assert type(got.latency_s) is float


@pytest.mark.parametrize(
    ("override", "value", "allowed"),
    [
        ("latency_s:=-1.0", "-1.0", "a number from 0 to 60 s"),
        ("latency_s:=.nan", "nan", "a number"),
        ("latency_s:=soon", "'soon'", "a number"),
        ("latency_s:=[1.0]", "[1.0]", "a number"),
        ("retries:=2.0", "2.0", "a whole number from 0 to 10"),
        ("mode:=some", "'some'", "one of full, none"),
        ("enabled:=1", "1", "true or false"),
    ],
)
def test_wrong_override_is_one_clear_line(
    make_node: MakeNode, override: str, value: str, allowed: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        declare(make_node, override)
    message = str(caught.value)
    assert message.startswith(f"parameter {override.split(':=', maxsplit=1)[0]} is ")
    assert value in message
    assert f"; allowed: {allowed}" in message
    assert "\n" not in message


def test_parameter_file_with_wildcard(make_node: MakeNode, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters:\n    latency_s: 4\n    mode: none\n")
    got = declare_parameters(make_node("--params-file", str(file)), Example)
    assert (got.latency_s, got.mode) == (4.0, Mode.NONE)


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
    assert node.get_parameter("mode").value == "full"
    assert node.get_parameter("latency_s").value == 2.0


def test_unknown_override_is_refused_with_a_suggestion(make_node: MakeNode) -> None:
    node = make_node("-p", "latncy_s:=1.0")
    declare_parameters(node, Example)
    with pytest.raises(ParameterError, match=r"latncy_s is unknown .* did you mean 'latency_s'\?"):
        node.reject_unknown_parameters()


def test_parameters_of_ros_itself_are_not_unknown(make_node: MakeNode) -> None:
    node = make_node("-p", "use_sim_time:=true")
    declare_parameters(node, Example)
    node.reject_unknown_parameters()

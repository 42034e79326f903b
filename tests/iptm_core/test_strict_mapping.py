"""Mappings of a file: every refusal names the place, the value, and what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from iptm_core.errors import ScenarioError, StoreError
from iptm_core.user_input import StrictMapping, suggestion

KNOWN = ("title", "speed", "parts", "notes")


def written(**content: Any) -> StrictMapping:
    return StrictMapping(content, "file.yaml", KNOWN)


def test_what_is_as_it_should_be_is_read() -> None:
    content = written(title="t", speed=3, parts=[1], notes={"a": True})
    assert (content.text("title"), content.number("speed")) == ("t", 3.0)
    assert content.entries("parts") == [1]
    assert content.section("notes").scalar("a") is True
    assert list(content) == ["title", "speed", "parts", "notes"]


def test_what_is_left_out() -> None:
    assert written().text("title", "none") == "none"
    assert written().section("notes").content == {}
    assert written().entries("parts", may_be_empty=True) == []
    assert "title" not in written()


@pytest.mark.parametrize(
    ("content", "read", "named"),
    [
        ({"title": 5}, lambda m: m.text("title"), "file.yaml: title is 5; allowed: a text"),
        ({}, lambda m: m.text("title"), "file.yaml: 'title' is missing"),
        ({"speed": True}, lambda m: m.number("speed"), "speed is True; allowed: a number"),
        ({"speed": 10**400}, lambda m: m.number("speed"), "allowed: a number that a float"),
        ({"parts": []}, lambda m: m.entries("parts"), "parts is []; allowed: a list"),
        ({"notes": 3}, lambda m: m.section("notes"), "file.yaml: notes holds 3; allowed: a map"),
        ({"notes": [1]}, lambda m: m.scalar("notes"), "notes is [1]; allowed: a number, a text"),
        ({"title": "c"}, lambda m: m.choice("title", "ab"), "title is 'c'; allowed: a, b"),
        ({}, lambda m: m.choice("title", "ab"), "'title' is missing; allowed: a, b"),
    ],
)
def test_what_is_wrong_is_refused(
    content: dict[str, Any], read: Callable[[StrictMapping], Any], named: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        read(written(**content))
    assert named in str(caught.value)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (None, "file.yaml holds nothing; allowed: a mapping"),
        ([1, 2], "file.yaml holds [1, 2]; allowed: a mapping"),
        ({3: "x"}, "file.yaml: key 3; allowed: a text"),
        ({"titel": "x"}, "file.yaml: unknown key 'titel'; did you mean 'title'?"),
    ],
)
def test_no_mapping_of_known_names(content: Any, named: str) -> None:
    with pytest.raises(StoreError) as caught:
        StrictMapping(content, "file.yaml", KNOWN, error=StoreError)
    assert named in str(caught.value)


def test_errors_keep_class_and_place_in_sections() -> None:
    content = StrictMapping({"notes": {"a": 1}}, "file.yaml", error=StoreError)
    with pytest.raises(StoreError, match=r"file\.yaml: notes: a is 1"):
        content.section("notes").text("a")


def test_very_many_names_are_not_all_listed() -> None:
    many = [f"group.parameter_{number}" for number in range(60)]
    assert suggestion("group.parametr_7", many) == "did you mean 'group.parameter_7'?"
    assert suggestion("zzz", many).count("group") == 12
    assert suggestion("speeed", KNOWN) == f"did you mean 'speed'? allowed: {', '.join(KNOWN)}"

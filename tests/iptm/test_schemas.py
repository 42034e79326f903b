"""The JSON schemas of trips and vehicles accept what is shipped, and refuse what the suite refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from tests.packaging.packages import ROOT

from iptm.trip_files import trip_folder
from iptm_core.parameters import loading

REFERENCE = ROOT / "docs" / "reference"
TRIPS = sorted([*trip_folder().glob("*.yaml"), *(ROOT / "studies/benchmark/tasks").glob("*.yaml")])
VEHICLES = sorted(Path(loading.__file__).parent.glob("sets/*.yaml"))


def refusals(schema: str, content: Any) -> list[str]:
    validator = jsonschema.Draft202012Validator(
        json.loads((REFERENCE / f"{schema}.schema.json").read_text("utf-8"))
    )
    return [error.message for error in validator.iter_errors(content)]


@pytest.mark.parametrize("path", TRIPS, ids=lambda path: path.stem)
def test_trips_are_valid(path: Path) -> None:
    assert refusals("trip", yaml.safe_load(path.read_text("utf-8"))) == []


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
def test_vehicles_are_valid(path: Path) -> None:
    assert refusals("vehicle", yaml.safe_load(path.read_text("utf-8"))) == []


@pytest.mark.parametrize(
    ("schema", "content", "word"),
    [
        ("trip", {"road": {"cyle": "us06"}}, "cyle"),
        ("trip", {"leader": {"dropout_probability": 1.5}}, "1.5"),
        ("trip", {"conditions": {"faults": [{"kind": "no_fault"}]}}, "no_fault"),
        ("trip", {"conditions": {"mode": "slow"}}, "slow"),
        ("vehicle", {"body": {"mass_kg": 1600.0}}, "1600"),
        ("vehicle", {"body": {"mass_kg": {"value": 1600.0, "source": "chosen"}}}, "unit"),
        ("vehicle", {"body": {"weight_kg": {"value": 1600.0}}}, "weight_kg"),
        (
            "vehicle",
            {"body": {"mass_kg": {"value": 1.0, "unit": "kg", "source": "heard"}}},
            "heard",
        ),
    ],
)
def test_mistakes_are_refused(schema: str, content: Any, word: str) -> None:
    assert any(word in message for message in refusals(schema, content))

"""The committed example bags stay readable, and their figures stay what they were."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from iptm.trip_files import trip_from
from iptm_core.metrics.figures import figure_values
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory
from iptm_ros.topics import TOPICS

BAGS = Path(__file__).resolve().parents[3] / "bags"
EXAMPLES = sorted(BAGS.glob("example_*"))
LARGEST_BYTES = 1_200_000


def test_there_is_an_example() -> None:
    assert EXAMPLES


@pytest.mark.parametrize("bag", EXAMPLES, ids=lambda path: path.name)
def test_figures_of_an_example_are_reproduced_from_its_bag(bag: Path) -> None:
    results = json.loads((bag / "results.json").read_text(encoding="utf-8"))
    parameters, is_stored = read_model_parameters(bag)
    assert is_stored
    metrics = compute_metrics(read_trajectory(bag), parameters, read_decisions(bag))
    stored = {row["key"]: row["value"] for row in results["rows"] if row["value"] is not None}
    values = figure_values(metrics)
    assert {key: values[key] for key in stored} == pytest.approx(stored, rel=1e-9, abs=1e-9)
    assert results["good"] is True


@pytest.mark.parametrize("bag", EXAMPLES, ids=lambda path: path.name)
def test_an_example_is_small_and_complete(bag: Path) -> None:
    assert sum(path.stat().st_size for path in bag.rglob("*")) < LARGEST_BYTES
    with BagReader(bag) as reader:
        types = {name: topic.type_name for name, topic in reader.topics.items()}
        information = reader.run_information()
    for spec in TOPICS.values():
        if spec.on_request:
            continue
        name = spec.name if spec.name.startswith("/") else f"/{spec.name}"
        assert types[name] == spec.type_name
    # The trip in the bag is enough to drive it again.
    content = parse_yaml(information.extra["trip"], "trip in the bag")
    again = trip_from(content, "bag", information.scenario, bag).checked()
    assert again.parameters == read_model_parameters(bag)[0]

"""Runs side by side, bags among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm_ros.recording.trajectory_reader import read_decisions, read_trajectory

BAG = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"


@pytest.fixture(scope="module")
def runs() -> list[iptm.Run]:
    return [
        iptm.simulate(
            "us06",
            strategy=strategy,
            horizon="3x1",
            duration_s=20.0,
            overrides={"body.mass_kg": mass_kg},
        )
        for strategy, mass_kg in (("aging", 1500.0), ("reference", 1500.0), ("reference", 1600.0))
    ]


@pytest.fixture(scope="module")
def bag() -> iptm.Run:
    return iptm.load(BAG)


def test_the_table_has_changes_against_the_first(runs: list[iptm.Run]) -> None:
    table = iptm.compare(runs[0], runs[1]).table
    assert table.columns.tolist() == ["aging", "reference", "reference: change [%]"]
    assert table.loc["aging_saved [%]"].isna().all(), "20 s are too short to judge"
    assert np.isfinite(table.loc["aging_saved_as_driven [%]", "reference"])
    own, other, change = table.loc["battery_energy [kJ]"]
    assert (own, other) == (runs[0].figures["battery_energy"], runs[1].figures["battery_energy"])
    assert change == pytest.approx(100.0 * (other / own - 1.0))
    assert np.isnan(table.loc["duration [s]", "reference: change [%]"])
    costs = [run.cost().eur for run in runs[:2]]
    assert table.index[-1] == "worth [EUR/100 km]"
    assert table.loc["worth [EUR/100 km]", "reference"] == pytest.approx(costs[0] - costs[1])


def test_only_what_differs_is_listed(runs: list[iptm.Run]) -> None:
    assert iptm.compare(*runs[:2]).differences.index.tolist() == ["strategy"]
    three = iptm.compare(*runs).differences
    assert three.index.tolist() == ["strategy", "body.mass_kg"]
    assert three.loc["body.mass_kg"].tolist() == [1500.0, 1500.0, 1600.0]


def test_labels_are_the_differences_or_those_given(runs: list[iptm.Run]) -> None:
    assert list(iptm.compare(*runs).runs) == [
        "aging, body.mass_kg=1500.0",
        "reference, body.mass_kg=1500.0",
        "reference, body.mass_kg=1600.0",
    ]
    assert list(iptm.compare(light=runs[1], heavy=runs[2]).runs) == ["light", "heavy"]
    assert len(iptm.compare(runs[0], runs[0]).runs) == 2


def test_all_runs_are_in_the_picture(runs: list[iptm.Run]) -> None:
    for axes in iptm.compare(*runs).plot().axes:
        assert len(axes.get_lines()) == 3


def test_a_bag_is_the_same_object(bag: iptm.Run) -> None:
    trajectory, decisions = read_trajectory(BAG), read_decisions(BAG)
    assert bag.frame["battery_power_w"].tolist() == trajectory.battery_power_w.tolist()
    assert bag.frame["iterations"].dropna().tolist() == decisions.iterations.tolist()
    assert bag.settings["slope"] == "small"
    assert bag.settings["preview_mode"] == "full"
    assert bag.plot().axes


def test_a_bag_beside_a_simulation(bag: iptm.Run, runs: list[iptm.Run]) -> None:
    both = iptm.compare(bag, runs[0])
    assert both.differences.loc["duration_s"].tolist() == [120.0, 20.0]
    assert "slope" in both.differences.index
    assert "period_s" not in both.differences.index


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda: iptm.load("/no/such/bag"), "does not exist"),
        (lambda: iptm.load(3), "bag is 3; allowed: the path of a bag"),  # type: ignore[arg-type]
        (iptm.compare, "0 runs; allowed: two or more"),
        (lambda: iptm.compare(1, 2), "run 0 is 1; allowed: what simulate"),  # type: ignore[arg-type]
    ],
)
def test_a_mistake_is_one_line(mistake, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(iptm.IptmError, match=message):
        mistake()


def test_a_page_holds_what_differs(runs: list[iptm.Run], tmp_path: Path) -> None:
    path = iptm.compare(one=runs[0], two=runs[1]).report(tmp_path / "page.html")
    text = path.read_text(encoding="utf-8")
    parts = ("<th>strategy</th>", "<td>reference</td>", "two: change", "Battery energy")
    for part in (
        *parts,
        "energy: too short to judge",
        "per distance driven; motion and heat",
    ):
        assert part in text
    with pytest.raises(iptm.IptmError, match=r"page\.html exists already; allowed: a new file"):
        runs[0].report(path)

"""The page is made from numbers alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.harness import write_numbers
from benchmarks.page import write_page
from benchmarks.targets import NOT_MEASURED, targets


def summary(name: str, median_ms: float, ratio: float) -> dict[str, object]:
    return {
        "name": name, "problems": 10, "unconverged": 0, "unusable": 0, "other_optimum": 0,
        "median_ms": median_ms, "p99_ms": 2.0 * median_ms, "max_ms": 3.0 * median_ms,
        "wall_median_ms": median_ms, "wall_p99_ms": median_ms,
        "iterations_median": 7.0, "iterations_p99": 9.0, "iterations_max": 11.0,
        "kkt_median": 1e-6, "kkt_max": 1e-5, "peer_by_median": ratio, "peer_by_p99": ratio,
    }  # fmt: skip


COMPARISONS = {
    "wltc_class3b, aging, 3x1+5x5": [summary("riccati", 1.0, 21.0), summary("peer_plain", 21.0, 1)],
    "wltc_class3b, aging, 15x1": [summary("riccati", 1.9, 20.0), summary("peer_plain", 38.0, 1)],
}
SCALING = {
    "rows": [
        {"solver": "riccati", "grid": f"{nodes}x1", "nodes": nodes, "problems": 2, "unconverged": 0,
         "median_ms": 0.1 * nodes, "max_ms": 0.2 * nodes, "iterations": 10.0,
         "ms_per_iteration": 0.01 * nodes}
        for nodes in (60, 100, 200)
    ],
    "fits": {"riccati": {"offset_ms": 0.0, "per_node_us": 10.0, "largest_relative_residual": 0.0,
                         "exponent": 1.0}},
}  # fmt: skip


def test_nothing_measured_nothing_claimed() -> None:
    assert {target.measured for target in targets({})} == {NOT_MEASURED}
    assert {target.verdict for target in targets({})} == {"-"}


def test_targets_are_judged_by_the_worst_case() -> None:
    reached = {target.text: target for target in targets({"comparisons": COMPARISONS})}
    assert reached["MH 3+5: at least 20 times faster than plain CasADi + IPOPT, median and p99"].met


def test_computing_time_is_that_of_all_solves() -> None:
    loops = [
        {"cycle": "wltc_class3b", "horizon": grid, "strategy": strategy, "ticks": 1800,
         "wall_s": 2.0, "processor_s": 2.0,
         "solve_total_s": total, "statuses": {"solved": 1800},
         "solve_ms": {"median": 1.0, "p99": 2.0, "max": 3.0},
         "solve_wall_ms": {"median": 1.0, "p99": 2.0, "max": 3.0}}
        for grid, strategy, total in (
            ("3x1+5x5", "aging", 1.06), ("15x1", "aging", 1.5), ("15x1", "reference", 2.0)
        )
    ]  # fmt: skip
    reached = {target.text: target for target in targets({"loops": loops})}
    half = reached[
        "MH 3+5 at no more than half the time of the reference on SH 15, all solves of a trip"
    ]
    assert half.met is False
    assert half.measured == "wltc_class3b: 0.53 (of itself on SH 15: 0.71)"


def test_a_page_with_pictures_is_written_from_some_numbers(tmp_path: Path) -> None:
    write_numbers(tmp_path / "numbers" / "comparisons.json", COMPARISONS)
    write_numbers(tmp_path / "numbers" / "scaling.json", SCALING)
    page = tmp_path / "solver-benchmarks.md"
    write_page(tmp_path / "numbers", page)
    text = page.read_text(encoding="utf-8")
    for picture in ("solvers.png", "nodes.png"):
        assert f"solver-benchmarks/{picture}" in text
        assert (tmp_path / "solver-benchmarks" / picture).stat().st_size > 1000
    assert "## Headless" not in text
    assert str(tmp_path) not in text


@pytest.mark.parametrize("part", ["comparisons", "scaling"])
def test_a_part_may_be_missing(part: str, tmp_path: Path) -> None:
    numbers = {"comparisons": COMPARISONS, "scaling": SCALING}[part]
    write_numbers(tmp_path / "numbers" / f"{part}.json", numbers)
    write_page(tmp_path / "numbers", tmp_path / "page.md")

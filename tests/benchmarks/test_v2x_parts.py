"""The V2X parts of the benchmarks, in small."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks import v2x_price
from benchmarks.harness import put

from iptm_core.errors import StoreError


def test_a_table_is_put_between_its_marks_and_nowhere_else() -> None:
    page = "a\n<!-- price -->\nold\n<!-- end of price -->\nz\n"
    once = put(page, "price", "| new |")
    assert "old" not in once
    assert "| new |" in once
    assert put(once, "price", "| new |") == once
    with pytest.raises(StoreError, match="no marks"):
        put("nothing", "price", "| new |")


def test_the_price_of_a_short_trip(tmp_path: Path) -> None:
    kept = tmp_path / "rows.jsonl"
    leaders = (v2x_price.DECAY, v2x_price.PATH)
    rows = v2x_price.measure(("nycc",), leaders, 60.0, cells=1, rows=str(kept))
    file, sensor, decay, path = rows
    names = ["file", v2x_price.SENSOR, v2x_price.DECAY, v2x_price.PATH]
    assert [row["leader"] for row in (file, sensor, decay, path)] == names
    assert path["degradation_1e7"] == pytest.approx(file["degradation_1e7"], rel=0.05)
    assert path["recovered_percent"] > 80.0
    assert (file["recovered_percent"], sensor["recovered_percent"]) == (100.0, 0.0)
    table = v2x_price.as_table(rows)["price"]
    assert table.count("| nycc |") == 4
    # What was driven is not driven again.
    text = kept.read_text("utf-8")
    again = v2x_price.measure(("nycc",), leaders, 60.0, cells=1, rows=str(kept))
    assert v2x_price.as_table(again)["price"] == table
    assert kept.read_text("utf-8") == text


def test_a_received_path_keeps_the_smallest_gap_as_the_file_does() -> None:
    """US06's hardest braking, where each m/s of a speed between the points is worth 8 m of the gap."""
    row = v2x_price.drive("us06", v2x_price.PATH, 0.02, duration_s=200.0)
    assert row["smallest_margin_m"] > 0.0


@pytest.mark.parametrize("seed", [1, 2])
def test_late_messages_of_a_leader_that_brakes_suddenly_keep_the_smallest_gap(seed: int) -> None:
    """B24 goes from speeding up to braking with 3 m/s2 within a second, unheard for 1 s to 1.7 s."""
    row = v2x_price.drive("B24", v2x_price.DECAY, 2.8, 0.5, 1.0, duration_s=215.0, seed=seed)
    assert row["smallest_margin_m"] > 0.0

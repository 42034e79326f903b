"""The V2X parts of the benchmarks, in small."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from benchmarks import v2x_price
from benchmarks.harness import put
from benchmarks.v2x_fuzz import fuzz

from iptm_core.errors import StoreError
from iptm_v2x_bridge.rejections import Rejection


def test_damaged_datagrams_have_only_the_stated_outcomes() -> None:
    found = fuzz(datagrams=3000, seed=4)
    allowed = {str(reason) for reason in Rejection} | {"read"}
    assert set(found["outcomes"]) <= allowed
    assert sum(found["outcomes"].values()) == 3000
    # Cut, flipped and invented ones reach every stage of the reading.
    stages = {"size", "packet", "header", "decoding", "constraint", "read"}
    assert stages <= set(found["outcomes"])
    assert found["grown_mib"] < 32.0


def test_a_table_is_put_between_its_marks_and_nowhere_else() -> None:
    page = "a\n<!-- price -->\nold\n<!-- end of price -->\nz\n"
    once = put(page, "price", "| new |")
    assert "old" not in once
    assert "| new |" in once
    assert put(once, "price", "| new |") == once
    with pytest.raises(StoreError, match="no marks"):
        put("nothing", "price", "| new |")


def test_the_price_of_a_short_trip(tmp_path: Path) -> None:
    rows = tmp_path / "rows.jsonl"
    leaders = (v2x_price.DECAY, v2x_price.PATH)
    numbers = v2x_price.measure(("nycc",), leaders, 60.0, cells=1, rows=str(rows))
    file, sensor, decay, path = numbers["rows"]
    names = ["file", v2x_price.SENSOR, v2x_price.DECAY, v2x_price.PATH]
    assert [row["leader"] for row in (file, sensor, decay, path)] == names
    assert path["degradation_1e7"] == pytest.approx(file["degradation_1e7"], rel=0.05)
    assert path["recovered_percent"] > 80.0
    assert math.isnan(sensor["recovered_percent"])
    assert v2x_price.as_table(numbers).count("\n") == 5
    # What was driven is not driven again.
    kept = rows.read_text("utf-8")
    again = v2x_price.measure(("nycc",), leaders, 60.0, cells=1, rows=str(rows))
    assert v2x_price.as_table(again) == v2x_price.as_table(numbers)
    assert rows.read_text("utf-8") == kept


def test_a_received_path_keeps_the_smallest_gap_as_the_file_does() -> None:
    """US06's hardest braking, where each m/s of a speed between the points is worth 8 m of the gap."""
    row = v2x_price.drive(v2x_price.Case("us06", v2x_price.PATH, 0.02), 200.0, seed=1)
    assert row["predictors"] == {"received_path": 201}
    assert row["smallest_margin_m"] > 0.0

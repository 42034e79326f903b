"""The V2X parts of the benchmarks, in small."""

from __future__ import annotations

import pytest
from benchmarks.v2x_fuzz import fuzz
from benchmarks.v2x_page import put

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

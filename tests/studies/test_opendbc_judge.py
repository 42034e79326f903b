"""opendbc's safety code judges what the gateway sends to three of its cars, with a mad suite behind it."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("opendbc")
pytest.importorskip("cantools")

from studies.gateway.opendbc_judge import CARS, ForeignCar, build, judged

FRAMES = 3_500
"""By car: more than 10,000 together."""


@pytest.fixture(scope="module")
def library() -> Any:
    return build()


@pytest.mark.parametrize("car", CARS, ids=[car.name for car in CARS])
def test_nothing_that_the_gateway_sends_is_blocked(library: Any, car: ForeignCar) -> None:
    counts = judged(library, car, FRAMES, seed=50)
    assert counts["enabled"] + counts["inactive"] == FRAMES
    assert counts["enabled"] > 0.1 * FRAMES
    assert counts["enabled, blocked"] == counts["inactive, blocked"] == 0
    assert counts["enabled, opendbc does not allow"] == 0
    # The judge is one: of the suite's own requests it lets a part pass.
    assert 0.1 < counts["asked, opendbc lets pass"] / counts["asked"] < 0.9

"""A crowd of cars by radio in real time; `scripts/study v2x --only load` has 2000 messages a second."""

from __future__ import annotations

import pytest
from studies.v2x.load import measure


def test_nothing_that_a_crowd_sends_is_lost() -> None:
    numbers = measure(cars=20, seconds=4)
    assert numbers["sent"] == 21 * 40
    assert numbers["read"] == numbers["sent"]
    assert "overflow" not in numbers["refused"]


@pytest.mark.slow  # in real time beside whatever else runs
def test_a_flood_of_maps_costs_no_message_of_a_car() -> None:
    pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")
    numbers = measure(cars=20, seconds=4, maps_per_s=1000)
    assert numbers["accepted"] == numbers["cams_sent"] == 21 * 40
    assert numbers["ticks_answered"] == 4
    assert set(numbers["refused"]) == {"waited"}
    assert numbers["refused"]["waited"] > 2000

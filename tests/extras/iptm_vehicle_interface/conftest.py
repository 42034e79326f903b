"""What all tests of the vehicle interface need: the libraries of its extra, and the bench car."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

collect_ignore_glob = (
    [] if all(map(find_spec, ("can", "cantools", "msgpack"))) else ["test_[!m]*.py"]
)
"""Without the libraries of requirements/can.txt only the meter can be tested."""

if TYPE_CHECKING:
    from iptm_vehicle_interface.channel import VehicleLink


@pytest.fixture(scope="session")
def vehicle() -> VehicleLink:
    from iptm_vehicle_interface.vehicle import load_vehicle  # noqa: PLC0415 - its library may be missing

    return load_vehicle("bench")

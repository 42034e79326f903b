"""What all tests of the vehicle interface need: the libraries of its extra, and the bench car."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

for library in ("can", "cantools", "msgpack"):
    pytest.importorskip(library, reason="requirements/can.txt is not installed")

if TYPE_CHECKING:
    from iptm_vehicle_interface.vehicle import Vehicle


@pytest.fixture(scope="session")
def vehicle() -> Vehicle:
    from iptm_vehicle_interface.vehicle import load_vehicle  # noqa: PLC0415 - its library may be missing

    return load_vehicle("bench")

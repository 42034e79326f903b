"""A small route for the tests of the bridge."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_core.routes import Route, build_route
from iptm_v2x_bridge.bridge import CycleSource


@pytest.fixture(scope="session")
def route() -> Route:
    return build_route("nycc", "large", initial_gap_m=15.0)


@pytest.fixture(scope="session")
def source(route: Route) -> CycleSource:
    return CycleSource(route)


@pytest.fixture
def user_cycle(tmp_path: Path) -> Path:
    path = tmp_path / "ramp.csv"
    path.write_text("time_s,speed_m_s\n0,0\n1,1\n2,2\n3,2\n4,0\n")
    return path

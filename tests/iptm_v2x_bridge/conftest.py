"""A small route for the tests of the bridge."""

from __future__ import annotations

import pytest

from iptm_core.routes import Route, build_route
from iptm_v2x_bridge.bridge import CycleSource


@pytest.fixture(scope="session")
def route() -> Route:
    return build_route("nycc", "large", initial_gap_m=15.0)


@pytest.fixture(scope="session")
def source(route: Route) -> CycleSource:
    return CycleSource(route)
